# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels of a job's stages: octree, light, animation, network, preview with advice, Compare, Refine with Cycles."""

from __future__ import annotations

import bpy

from ...patchnet_addon.export.fine_light import fine_light_text
from ...patchnet_addon.lod.fitted_levels import LOOK_AHEAD_SHARE
from ...patchnet_addon.runtime.quantities import error_text
from ...patchnet_addon.sampling.registry import STRATEGIES
from ..schema.setting import Place
from ..schema.values import AUTO, CAMERAS, CODES, CYCLES, GLOSS_OFF, IMPORTANCE, LIGHT, OCTREE, OUTPUT, REFINEMENT, VIEW
from ..session import results
from ..session.scene_result import SceneResult
from ..settings.job_settings import recorded
from . import tab


class PATCHNET_PT_octree(tab.SubPanel, bpy.types.Panel):
    """Octree: its objects and its resolution."""

    bl_label = "Octree"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw settings, the button, and why voxels are out of date."""
        layout = tab.split(self.layout)
        tab.draw_settings(layout, context.scene.patchnet, OCTREE)
        layout.operator("patchnet.voxelize", icon="MESH_GRID")
        layout.operator("patchnet.load_octree", icon="FILEBROWSER")
        tab.draw_stale(layout, context, "surface")
        tab.draw_advanced(layout, context.scene.patchnet, OCTREE)


class PATCHNET_PT_light(tab.SubPanel, bpy.types.Panel):
    """Light of the voxels and its source."""

    bl_label = "Light"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw settings, the button, where light is fine, and limits of the bake."""
        layout = tab.split(self.layout)
        tab.draw_settings(layout, context.scene.patchnet, LIGHT)
        layout.operator("patchnet.bake_light", icon="LIGHT")
        tab.draw_stale(layout, context, "light")
        result = results.result_of(context.scene)
        if result is not None and (text := fine_light_text(result.octree)):
            tab.draw_sentence(layout, context, text, "INFO")
        if context.scene.patchnet.light == CYCLES and context.scene.patchnet.gloss == GLOSS_OFF:
            tab.draw_sentence(layout, context, "Diffuse light only, no gloss", "INFO")
        tab.draw_advanced(layout, context.scene.patchnet, LIGHT)


class PATCHNET_PT_animation(tab.Tab, bpy.types.Panel):
    """All frames, each with its own octree and pictures."""

    bl_label = "Animation"
    bl_parent_id = "PATCHNET_PT_light"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the scene's frames, the settings, and the button."""
        layout = tab.split(self.layout)
        column = layout.column(align=True)
        for name, text in (("frame_start", "Frame Start"), ("frame_end", "End"), ("frame_step", "Step")):
            column.prop(context.scene, name, text=text)
        for name in ("skip_existing", "same_grid"):
            layout.prop(context.scene.patchnet, name)
        tab.draw_setting(layout, context.scene.patchnet, "out")
        layout.operator("patchnet.bake_animation", icon="RENDER_ANIMATION")


class PATCHNET_PT_network(tab.SubPanel, bpy.types.Panel):
    """Network for look-ahead."""

    bl_label = "Network"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw settings, the button, and the name of the encoder that made the codes."""
        layout = tab.split(self.layout)
        tab.draw_settings(layout, context.scene.patchnet, CODES)
        layout.operator("patchnet.precompute_codes", icon="NODETREE")
        result = results.result_of(context.scene)
        if result is None or result.coded is None:
            return
        if result.encoder:
            tab.draw_sentence(layout, context, f"Prepared by {result.encoder}", "INFO")
        if why := tab.changed_text(context.scene.patchnet, result.made_with.get("codes"), "codes"):
            tab.draw_sentence(layout, context, f"{why}: prepare again", "ERROR")


BETTER = 0.95  # another strategy is recommended below this share of the chosen one's error


def advice(result: SceneResult, values: bpy.types.PropertyGroup) -> list[str]:
    """Advice on a result's last view, if there is one. values: settings of its scene."""
    return [*filter(None, (_look_ahead(result, values), _strategy(result, values)))]


def _look_ahead(result: SceneResult, values: bpy.types.PropertyGroup) -> str:
    share = result.lookahead_share
    if share is None or share >= LOOK_AHEAD_SHARE:
        return ""
    again = "press Preview Selection again"
    text = f"Voxels are too coarse to look ahead on {1.0 - share:.0%} of this picture: "
    if values.resolution == AUTO:
        return f"{text}{again} if camera or size changed, else choose a smaller Picture Size or fewer cameras"
    return f"{text}choose Voxel Detail: Automatic, then {again}"


def _strategy(result: SceneResult, values: bpy.types.PropertyGroup) -> str:
    """Advice on the best strategy, if clearly better; only for the compared view."""
    same = _others(recorded(values, VIEW)) == _others(result.made_with.get(VIEW, {}))
    if result.comparison is None or result.why(VIEW) or not same:
        return ""
    rows = {row.name: row for row in result.comparison.rows if STRATEGIES[row.name].group != "oracle"}
    chosen = rows.get(values.strategy)
    best = min(rows.values(), key=lambda row: row.error, default=None)
    if chosen is None or best is None or best.error > BETTER * chosen.error:
        return ""
    less = 1.0 - best.error / chosen.error
    leaves = f"leaves {less:.0%} less error than {chosen.title}"
    return f"In this picture {best.title} {leaves}: choose Strategy: {best.title}, and render again"


def _others(settings: dict[str, object]) -> dict[str, object]:
    """Settings of a view except its strategy, of which a comparison is independent."""
    return {name: value for name, value in settings.items() if name != "strategy"}


class PATCHNET_PT_preview(tab.SubPanel, bpy.types.Panel):
    """Preview of a view, its errors and its refinement."""

    bl_label = "Preview"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw settings, the button, and advice on the picture."""
        layout = tab.split(self.layout)
        values = context.scene.patchnet
        tab.draw_settings(layout, values, CAMERAS, VIEW, OUTPUT)
        layout.operator("patchnet.render_preview", icon="RENDER_STILL")
        tab.draw_stale(layout, context, "view")
        result = results.result_of(context.scene)
        if result is not None and result.pictures:
            for text in advice(result, values):
                tab.draw_remedy(layout.box(), context, text, "LIGHT_DATA")
        tab.draw_advanced(layout, values, VIEW)


class PATCHNET_PT_importance(tab.Tab, bpy.types.Panel):
    """Painted importance."""

    bl_label = "Importance"
    bl_parent_id = "PATCHNET_PT_preview"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the source, and its name."""
        layout = tab.split(self.layout)
        tab.draw_settings(layout, context.scene.patchnet, IMPORTANCE)
        if context.scene.patchnet.importance != "NONE":
            tab.draw_sentence(layout, context, "Black or weight 0 is never refined", "INFO")


_NAMES = 0.5  # of the table's width


class PATCHNET_PT_compare(tab.SubPanel, bpy.types.Panel):
    """Strategies compared: the error that each leaves on the chosen view."""

    bl_label = "Compare"
    bl_order = tab.LAST

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the button, and the table of the last comparison."""
        layout = tab.split(self.layout)
        layout.operator("patchnet.compare", icon="SORTSIZE")
        tab.draw_settings(layout, context.scene.patchnet, VIEW, place=Place.COMPARE)
        layout.prop(context.scene.patchnet, "strategy", text="Use Strategy")  # of all
        result = results.result_of(context.scene)
        if result is None or result.comparison is None:
            tab.draw_sentence(layout, context, "Not compared yet", "INFO")
            return
        found = result.comparison
        tab.draw_stale(layout, context, "view")
        tab.draw_sentence(layout, context, f"{found.view}: squared error x 10,000, budget {found.budget:.0%}")
        table = layout.box().column(align=True)
        _row(table, context, "Strategy", "Error", "Left")
        rows = [(f"{title}, unrefined", error) for title, error in found.pictures]
        chosen = context.scene.patchnet.strategy
        rows += [(f"{'> ' if row.name == chosen else ''}{row.title}", row.error) for row in found.rows]
        for name, error in rows:
            share = f"{error / found.unrefined:.0%}" if found.unrefined else "-"
            _row(table, context, name, error_text(error), share)


def _row(layout: bpy.types.UILayout, context: bpy.types.Context, name: str, error: str, share: str) -> None:
    row = layout.split(factor=_NAMES)
    tab.draw_sentence(row, context, name, share=_NAMES)
    numbers = row.split(factor=0.6)
    numbers.label(text=error)
    numbers.label(text=share)


class PATCHNET_PT_cycles_refine(tab.SubPanel, bpy.types.Panel):
    """Refinement with Cycles: its share of the preview and its quality."""

    bl_label = "Refine with Cycles"
    bl_order = tab.LAST

    def draw(self, context: bpy.types.Context) -> None:
        """Draw settings, then the button."""
        layout = tab.split(self.layout)
        tab.draw_settings(layout, context.scene.patchnet, REFINEMENT)
        layout.operator("patchnet.refine_with_cycles", icon="RENDER_STILL")
