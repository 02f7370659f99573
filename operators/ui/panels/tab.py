# SPDX-License-Identifier: GPL-3.0-or-later
"""Base classes of all panels; drawing reads settings and what was kept, and computes nothing."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

import bpy

from ...schema.setting import Kind
from ...schema.table import TABLE
from ...session import results
from ...session.scene_result import SceneResult
from ...session.staleness import look_soon
from ...settings.step_settings import changed, step_settings

if TYPE_CHECKING:
    from bpy.types import Panel as _Panel
else:
    _Panel = object  # Blender wants its own class among the direct bases of each panel

# Settings that a first user sees; sub-panels have all others.
FIRST = ("scope", "resolution", "depth", "voxel_size", "samples", "size", "budget")
# What empty text settings mean.
_WHEN_EMPTY = {"out": "No Files", "weights": "Shipped", "cameras": "Active Camera"}
# Of a line in a region: mean width of a character where Blender's texts are not scaled, and characters that icon and
# margins take.
_CHARACTER_PX, _MARGIN, _SHORTEST = 6.5, 8, 24
_ADVICE = {
    "surface": ("voxelize again", "octree"),
    "light": ("bake again", "light"),
    "view": ("render again", "view"),
}


class Tab(_Panel):
    """Panel of the sidebar tab."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "PatchNet"


class SubPanel(Tab):
    """Panel below the first one."""

    bl_parent_id = "PATCHNET_PT_main"


def split(layout: bpy.types.UILayout) -> bpy.types.UILayout:
    """Layout with names left and values right, as Blender's own panels have it."""
    layout.use_property_split = True
    layout.use_property_decorate = False
    return layout


def draw_settings(layout: bpy.types.UILayout, values: bpy.types.PropertyGroup, step: str) -> None:
    """Draw the settings of a step that count now, but those of the first panel."""
    for name in step_settings(values, step):
        if name not in FIRST:
            draw_setting(layout, values, name)


def draw_first(layout: bpy.types.UILayout, values: bpy.types.PropertyGroup) -> None:
    """Draw the first panel's settings that count now."""
    for name in FIRST:
        if TABLE[name].counts(values):
            row = layout.row()
            row.active = name != "budget" or not values.spp
            draw_setting(row, values, name)


def draw_setting(layout: bpy.types.UILayout, values: bpy.types.PropertyGroup, name: str) -> None:
    """Draw a setting as its kind wants it: a list of images, sides in pixels, a checkbox where 0 is automatic."""
    if name == "importance_image":
        layout.prop_search(values, name, bpy.data, "images")
    elif name == "size":
        column = layout.column(align=True)
        both = "" if any(values.size) else "As Render"
        _draw_automatic(column, values, "size_x", "Picture Size X", both or TABLE[name].automatic)
        _draw_automatic(column, values, "size_y", "Y", both or TABLE[name].automatic)
    elif name == "strategy":
        layout.prop(values, "short_strategy")
    elif name in TABLE and TABLE[name].kind is Kind.AUTOMATIC:
        _draw_automatic(layout, values, name, TABLE[name].label, TABLE[name].automatic)
    elif name == "cameras":
        layout.prop(values, name, placeholder=_WHEN_EMPTY[name], icon="CAMERA_DATA")
    else:
        layout.prop(values, name, placeholder=_WHEN_EMPTY.get(name, ""))


def _draw_automatic(
    layout: bpy.types.UILayout, values: bpy.types.PropertyGroup, name: str, label: str, automatic: str
) -> None:
    """Draw a checkbox, and the number where it is on, else what is taken instead."""
    row = layout.row(heading=label)
    row.prop(values, f"use_{name}", text="")
    if getattr(values, f"use_{name}"):
        row.prop(values, name, text="")
    else:
        row.label(text=automatic)


def draw_samples(layout: bpy.types.UILayout, values: bpy.types.PropertyGroup) -> None:
    """Draw how many samples pixels get; those of the budget are gray where a mean counts instead."""
    row = layout.row()
    row.active = not values.spp
    draw_setting(row, values, "refined_samples")
    draw_setting(layout, values, "spp")


def draw_sentence(layout: bpy.types.UILayout, context: bpy.types.Context, text: str, icon: str) -> None:
    """Draw a sentence in as many lines as the region is wide, the first with an icon."""
    region, scale = context.region, context.preferences.system.ui_scale  # which is 0 without a window
    width = region.width / scale if region is not None and scale else 0.0
    column = layout.column(align=True)
    for line in textwrap.wrap(text, max(int(width / _CHARACTER_PX) - _MARGIN, _SHORTEST)):
        column.label(text=line, icon=icon)
        icon = "BLANK1"


def draw_stale(layout: bpy.types.UILayout, scene: bpy.types.Scene, *steps: str) -> None:
    """Draw why results do not fit any more, and what to do, for steps of "surface", "light", "view"."""
    result = results.result_of(scene)
    if result is None:
        return
    look_soon()
    for step in steps:
        if text := stale_text(result, scene, step):
            layout.label(text=text, icon="ERROR")


def stale_text(result: SceneResult, scene: bpy.types.Scene, step: str) -> str:
    """Reason for a step not fitting any more, and what to do, or ""."""
    advice, settings = _ADVICE[step]
    why = result.why(step)
    if not why and settings in result.made_with:
        name = changed(scene.patchnet, result.made_with[settings], settings)
        why = f"'{name}' changed" if name else ""
    return f"{why[:1].upper()}{why[1:]}: {advice}" if why else ""
