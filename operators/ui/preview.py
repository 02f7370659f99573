# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels of the preview: cameras, strategy, budget and painted importance; advice; Compare; Refine with Cycles."""

from __future__ import annotations

import bpy

from ...patchnet_addon.runtime.quantities import error_text
from ...patchnet_addon.sampling.registry import STRATEGIES
from ..schema.table import AUTO, FIT, VIEW
from ..session import results
from ..session.scene_result import SceneResult
from ..settings.job_settings import recorded
from .tab import (
    LAST,
    SubPanel,
    Tab,
    draw_advanced,
    draw_remedy,
    draw_samples,
    draw_sentence,
    draw_setting,
    draw_settings,
    draw_stale,
    split,
)  # fmt: skip

BETTER = 0.95  # another strategy is recommended below this share of the chosen one's error


def advice(result: SceneResult, values: bpy.types.PropertyGroup) -> list[str]:
    """Advice on a result's last view, if there is one. values: settings of its scene."""
    return [*filter(None, (_look_ahead(result, values), _strategy(result, values)))]


def _look_ahead(result: SceneResult, values: bpy.types.PropertyGroup) -> str:
    from ...patchnet_addon.lod.depth import LOOK_AHEAD_SHARE  # loaded already, as there is a result

    share = result.lookahead_share
    if share is None or share >= LOOK_AHEAD_SHARE:
        return ""
    again = "press Preview Selection again"
    text = f"Voxels are too coarse to look ahead on {1.0 - share:.0%} of this picture: "
    if values.resolution == FIT:
        return f"{text}choose a smaller Picture Size or fewer cameras, then {again}"
    if values.resolution == AUTO:
        return f"{text}{again} if camera or size changed, else choose Voxel Detail: Fit to Cameras"
    return f"{text}choose Voxel Detail: By Cameras, then {again}"


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


class PATCHNET_PT_preview(SubPanel, bpy.types.Panel):
    """Preview of a view, its errors and its refinement."""

    bl_label = "Preview"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw settings, the button, and advice on the picture."""
        layout = split(self.layout)
        values = context.scene.patchnet
        for name in ("cameras", "strategy", "unrefined"):
            draw_setting(layout, values, name)
        draw_samples(layout, values)
        draw_setting(layout, values, "out")
        layout.operator("patchnet.render_preview", icon="RENDER_STILL")
        draw_stale(layout, context, "view")
        result = results.result_of(context.scene)
        if result is not None and result.pictures:
            for text in advice(result, values):
                draw_remedy(layout.box(), context, text, "LIGHT_DATA")
        draw_advanced(layout, values, "view")


class PATCHNET_PT_importance(Tab, bpy.types.Panel):
    """Painted importance."""

    bl_label = "Importance"
    bl_parent_id = "PATCHNET_PT_preview"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the source, and its name."""
        layout = split(self.layout)
        draw_settings(layout, context.scene.patchnet, "importance")
        if context.scene.patchnet.importance != "NONE":
            draw_sentence(layout, context, "Black or weight 0 is never refined", "INFO")


_NAMES = 0.5  # of the table's width


class PATCHNET_PT_compare(SubPanel, bpy.types.Panel):
    """Strategies compared: the error that each leaves on the chosen view."""

    bl_label = "Compare"
    bl_order = LAST
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the button, and the table of the last comparison."""
        layout = split(self.layout)
        layout.operator("patchnet.compare", icon="SORTSIZE")
        draw_setting(layout, context.scene.patchnet, "reference")
        layout.prop(context.scene.patchnet, "strategy", text="Use Strategy")  # of all
        result = results.result_of(context.scene)
        if result is None or result.comparison is None:
            draw_sentence(layout, context, "Not compared yet", "INFO")
            return
        found = result.comparison
        draw_stale(layout, context, "view")
        draw_sentence(layout, context, f"{found.view}: squared error x 10,000, budget {found.budget:.0%}")
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
    draw_sentence(row, context, name, share=_NAMES)
    numbers = row.split(factor=0.6)
    numbers.label(text=error)
    numbers.label(text=share)


class PATCHNET_PT_cycles_refine(SubPanel, bpy.types.Panel):
    """Refinement with Cycles: its share of the preview and its quality."""

    bl_label = "Refine with Cycles"
    bl_order = LAST
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw settings, then the button."""
        layout = split(self.layout)
        for name in ("budget", "samples", "light", "compare"):
            layout.prop(context.scene.patchnet, f"cycles_{name}")
        layout.operator("patchnet.refine_with_cycles", icon="RENDER_STILL")
