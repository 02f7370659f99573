# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar tab PatchNet. Drawing reads settings and summaries, and computes nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

from ..patchnet_addon.octree.export.vdb import vdb_module_name
from . import results
from .job_operator import JobOperator

_STALE = {
    "surface": "Objects changed: voxelize again",
    "light": "Light changed: bake again",
}
_WHEN_EMPTY = {"out": "No Files", "weights": "Shipped", "cameras": "Active Camera"}  # what empty text settings mean


if TYPE_CHECKING:
    from bpy.types import Panel as _Panel
else:
    _Panel = object  # Blender wants its own class among the direct bases of each panel


class _Tab(_Panel):
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "PatchNet"


class PATCHNET_PT_main(_Tab, bpy.types.Panel):
    """Everything in one click, and the state of the result."""

    bl_label = "PatchNet"

    def draw(self, context: bpy.types.Context) -> None:
        """The button that does everything, and where files go."""
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        if JobOperator.running:  # in the button's place, so that the buttons below stay where they are
            layout.progress(factor=JobOperator.fraction, text=f"{JobOperator.running}: Esc stops")
        else:
            layout.operator("patchnet.run_all", icon="PLAY")
        layout.prop(context.scene.patchnet, "out", placeholder=_WHEN_EMPTY["out"])


class _Step(_Tab):
    """A sub-panel of one operator and its settings."""

    bl_parent_id = "PATCHNET_PT_main"
    operator = ""
    settings: tuple[str, ...] = ()

    def draw(self, context: bpy.types.Context) -> None:
        """Settings, then the button."""
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        values = context.scene.patchnet
        for name in self.visible_settings(values):
            layout.prop(values, name, placeholder=_WHEN_EMPTY.get(name, ""))
        layout.operator(self.operator)

    def visible_settings(self, _values: bpy.types.PropertyGroup) -> tuple[str, ...]:
        """Settings that matter with the present values."""
        return self.settings


class PATCHNET_PT_voxelize(_Step, bpy.types.Panel):
    """Objects and resolution."""

    bl_label = "1  Voxels"
    operator = "patchnet.voxelize"

    def visible_settings(self, values: bpy.types.PropertyGroup) -> tuple[str, ...]:
        """Depth and voxel size exclude each other."""
        chosen = {"DEPTH": ("depth",), "VOXEL_SIZE": ("voxel_size",), "FIT": ("track",)}.get(values.resolution, ())
        return ("scope", "resolution", *chosen, "memory")


class PATCHNET_PT_light(_Step, bpy.types.Panel):
    """Light and samples."""

    bl_label = "2  Light"
    operator = "patchnet.bake_light"

    def visible_settings(self, values: bpy.types.PropertyGroup) -> tuple[str, ...]:
        """Samples are for Cycles."""
        baked = ("samples", "texel_voxels", "fronts_only") if values.light == "cycles" else ()
        return ("light", *baked, "exposure", "color")

    def draw(self, context: bpy.types.Context) -> None:
        """The step, and what baking leaves out."""
        super().draw(context)
        self.layout.label(text="Diffuse light only, no gloss", icon="INFO")


class PATCHNET_PT_animation(_Tab, bpy.types.Panel):
    """All frames, each with its own octree and pictures."""

    bl_label = "Animation"
    bl_parent_id = "PATCHNET_PT_light"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """The scene's frames, the settings, and the button."""
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        column = layout.column(align=True)
        for name, text in (("frame_start", "Frame Start"), ("frame_end", "End"), ("frame_step", "Step")):
            column.prop(context.scene, name, text=text)
        for name in ("skip_existing", "same_grid"):
            layout.prop(context.scene.patchnet, name)
        layout.operator("patchnet.bake_animation", icon="RENDER_ANIMATION")
        if not context.scene.patchnet.out:
            layout.label(text="Choose the output folder above", icon="INFO")


class PATCHNET_PT_codes(_Step, bpy.types.Panel):
    """Weights."""

    bl_label = "3  Look-Ahead"
    operator = "patchnet.precompute_codes"
    settings = ("weights",)


class PATCHNET_PT_view(_Step, bpy.types.Panel):
    """Cameras, strategy and budget."""

    bl_label = "4  Views"
    operator = "patchnet.render_preview"
    settings = ("cameras", "size", "strategy", "budget", "heatmap_maximum")


class PATCHNET_PT_result(_Tab, bpy.types.Panel):
    """State of the result."""

    bl_label = "Result"
    bl_parent_id = "PATCHNET_PT_main"

    def draw(self, context: bpy.types.Context) -> None:
        """What is there, and what does not fit the scene any more."""
        layout = self.layout
        result = results.result_of(context.scene)
        if result is None:
            layout.label(text="Nothing computed yet")
            return
        for name in sorted(result.stale, reverse=True):  # surface before light, as the steps are
            layout.label(text=_STALE[name], icon="ERROR")
        column = layout.column(align=True)
        for line in result.summary:
            column.label(text=line)
        if result.lookahead_share is not None:
            column.label(text="Pictures: see an Image Editor", icon="IMAGE_DATA")
        layout.operator("patchnet.clear_results", icon="TRASH")


class PATCHNET_PT_voxels(_Tab, bpy.types.Panel):
    """The voxels as an object, and as files."""

    bl_label = "Show and Export"
    bl_parent_id = "PATCHNET_PT_main"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Settings, the two buttons, and what this Blender cannot write."""
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        for name in ("level", "display", "limit"):
            layout.prop(context.scene.patchnet, name)
        layout.operator("patchnet.show_voxels", icon="MESH_CUBE")
        layout.operator("patchnet.export_octree", icon="EXPORT")
        if not vdb_module_name():  # looked for once
            layout.label(text="This Blender cannot write .vdb", icon="INFO")


CLASSES = (
    PATCHNET_PT_main,
    PATCHNET_PT_voxelize,
    PATCHNET_PT_light,
    PATCHNET_PT_animation,
    PATCHNET_PT_codes,
    PATCHNET_PT_view,
    PATCHNET_PT_result,
    PATCHNET_PT_voxels,
)
