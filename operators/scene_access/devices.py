# SPDX-License-Identifier: GPL-3.0-or-later
"""Devices, CPU or GPU, that Cycles bakes on."""

from __future__ import annotations

import bpy

from ...patchnet_addon.runtime.errors import SettingError
from ..schema.values import AUTO, CPU, GPU

_ENABLE = "enable one in the preferences under System > Cycles Render Devices, or choose the CPU"


def gpu_is_enabled(context: bpy.types.Context) -> bool:
    """Return whether a GPU is enabled in the preferences of Cycles."""
    addon = context.preferences.addons.get("cycles")
    return addon is not None and bool(addon.preferences.has_active_device())


def bakes_on_gpu(context: bpy.types.Context, device: str = AUTO) -> bool:
    """Return whether a bake on AUTO, CPU or GPU runs on a GPU.

    Raises SettingError if a GPU is asked for and none is enabled.
    """
    if device == CPU:
        return False
    enabled = gpu_is_enabled(context)
    if device == GPU and not enabled:
        raise SettingError(f"Cycles has no GPU to bake on: {_ENABLE}")
    return enabled


def device_text(context: bpy.types.Context, device: str = AUTO) -> str:
    """Name of the device that a bake would run on; raises as `bakes_on_gpu`."""
    if not bakes_on_gpu(context, device):
        return "CPU"
    values = context.preferences.addons["cycles"].preferences
    names = [entry.name for entry in values.devices if entry.use and entry.type == values.compute_device_type]
    return f"GPU ({', '.join(names)})" if names else "GPU"
