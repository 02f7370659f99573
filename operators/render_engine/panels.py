# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels of the Properties editor for this engine: its own, and compatible ones of Blender."""

from __future__ import annotations

from typing import Any

import bpy

from ..gpu_view.cards import is_there, why_cpu
from ..jobs.job_operator import job_in_window
from ..overlay.overlay_settings import overlay_settings
from ..schema.values import IMPORTANCE
from ..session import results
from ..settings.job_settings import TABLE
from ..ui.tab import PanelBase, draw_progress, draw_sentence, draw_setting, draw_settings, split
from .engine import ENGINE

# EEVEE panels whose settings affect a bake.
_BORROWED = frozenset(
    {"DATA_PT_EEVEE_light", "EEVEE_MATERIAL_PT_context_material", "EEVEE_MATERIAL_PT_surface",
     "EEVEE_WORLD_PT_surface", "MATERIAL_PT_preview"}
)  # fmt: skip
# Panels that every engine gets, without effect in this one.
_LEFT_OUT = ("VIEWLAYER_PT_freestyle", "RENDER_PT_freestyle", "MATERIAL_PT_freestyle", "RENDER_PT_stereoscopy",
             "EEVEE_MATERIAL_PT_viewport_settings", "DATA_PT_light")  # fmt: skip


class _RenderPanel(PanelBase):
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"
    bl_order = -1  # above Simplify, as in Cycles
    COMPAT_ENGINES = {ENGINE}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Require this engine."""
        return context.engine in cls.COMPAT_ENGINES


class PATCHNET_PT_render_refinement(_RenderPanel, bpy.types.Panel):
    """Sampling of the render engine: order and amount of refinement."""

    bl_label = "Sampling"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw samples of all pixels, else strategy and budget, and painted importance, as in the sidebar."""
        layout = split(self.layout)
        draw_setting(layout, context.scene.patchnet, "render_samples")
        if context.scene.patchnet.render_samples:
            draw_settings(layout, context.scene.patchnet, IMPORTANCE)
            return
        draw_setting(layout, context.scene.patchnet, "strategy")
        for name in ("unrefined", "budget"):
            layout.prop(context.scene.patchnet, name)
        for name in ("refined_samples", "spp"):
            draw_setting(layout, context.scene.patchnet, name)
        draw_settings(layout, context.scene.patchnet, IMPORTANCE)


class PATCHNET_PT_render_octree(_RenderPanel, bpy.types.Panel):
    """Voxels that the render engine renders from."""

    bl_label = "Voxels"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw settings of new voxels, the button that makes them, and the state of the present ones."""
        layout = split(self.layout)
        for name in ("scope", "resolution", "depth", "voxel_size", "light", "noise_threshold"):
            if TABLE[name].counts(context.scene.patchnet):
                layout.prop(context.scene.patchnet, name)
        job = job_in_window().display
        if job is not None:
            draw_progress(layout, job)
        else:
            layout.operator("patchnet.run_all", icon="PLAY")
        result = results.result_of(context.scene)
        column = layout.column(align=True)
        if result is None:
            column.label(text="No voxels yet", icon="INFO")
        else:
            if result.stale:
                draw_sentence(column, context, "The scene has changed", "ERROR")
            for line in result.summary:
                draw_sentence(column, context, line)
            if line := why_cpu(result.octree):
                draw_sentence(column, context, line)


class PATCHNET_PT_render_film(_RenderPanel, bpy.types.Panel):
    """Background, and the pixel filter that Cycles has, too."""

    bl_label = "Film"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the properties."""
        layout, scene = split(self.layout), context.scene
        layout.prop(scene.render, "film_transparent", text="Transparent")
        cycles = getattr(scene, "cycles", None)
        if cycles is None:
            layout.prop(scene.render, "filter_size", text="Filter Size")
            return
        layout.prop(cycles, "pixel_filter_type", text="Pixel Filter")
        if cycles.pixel_filter_type != "BOX":
            layout.prop(cycles, "filter_width", text="Width")


CLASSES = (PATCHNET_PT_render_refinement, PATCHNET_PT_render_octree, PATCHNET_PT_render_film)


def _draw_live(header: bpy.types.Header, context: bpy.types.Context) -> None:
    """Draw the choice of a pass in the header of viewports that the graphics card draws."""
    result = results.result_of(context.scene)
    rendered = context.engine == ENGINE and context.space_data.shading.type == "RENDERED"
    if rendered and result is not None and is_there(result.octree):
        header.layout.prop(overlay_settings(context), "live", text="")


MENUS = (("VIEW3D_HT_header", _draw_live),)


def register() -> None:
    """Show Blender's own panels with this engine."""
    for panel in bpy.types.Panel.__subclasses__():
        engines: Any = getattr(panel, "COMPAT_ENGINES", None)
        general = isinstance(engines, set) and "BLENDER_RENDER" in engines
        if panel.__name__ in _BORROWED or (general and not panel.__name__.startswith(_LEFT_OUT)):
            engines.add(ENGINE)


def unregister() -> None:
    """Hide Blender's own panels again."""
    for panel in bpy.types.Panel.__subclasses__():
        engines = getattr(panel, "COMPAT_ENGINES", None)
        if isinstance(engines, set) and panel not in CLASSES:
            engines.discard(ENGINE)
