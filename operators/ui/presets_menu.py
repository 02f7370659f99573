# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets of the settings, in Blender's own preset menu: those that are shipped, and the user's own."""

from __future__ import annotations

from pathlib import Path

import bpy
from bl_operators.presets import AddPresetBase  # type: ignore[import-not-found]
from bl_ui.utils import PresetPanel

_FOLDER = "patchnet"
_VALUES = (
    "resolution", "depth", "voxel_size", "track", "light", "noise_threshold", "max_samples", "color", "size",
    "strategy", "unrefined", "budget", "refined_samples", "spp",
)  # fmt: skip


class PATCHNET_PT_presets(PresetPanel, bpy.types.Panel):
    """Voxel detail, light, pictures and pixel budget by name."""

    bl_label = "PatchNet Presets"
    preset_subdir = _FOLDER
    preset_operator = "script.execute_preset"
    preset_add_operator = "patchnet.add_preset"


class PATCHNET_OT_add_preset(AddPresetBase, bpy.types.Operator):
    """Add the present settings to the presets, or remove the chosen preset"""

    bl_idname = "patchnet.add_preset"
    bl_label = "Add PatchNet Preset"
    preset_menu = "PATCHNET_PT_presets"
    preset_subdir = _FOLDER
    preset_defines = ["settings = bpy.context.scene.patchnet"]
    preset_values = [f"settings.{name}" for name in _VALUES]


def register() -> None:
    """Register the folder of the shipped presets."""
    bpy.utils.register_preset_path(str(Path(__file__).parent))


def unregister() -> None:
    """Unregister the folder of the shipped presets."""
    bpy.utils.unregister_preset_path(str(Path(__file__).parent))
