# SPDX-License-Identifier: GPL-3.0-or-later
"""Parts of panels: settings, sentences with buttons for the settings in them, progress, outdated steps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import blf
import bpy

from ...patchnet_addon.runtime.quantities import counted
from ..jobs.job_window import JobDisplay
from ..schema.setting import Kind, Place
from ..schema.values import CAMERAS, COMBINED
from ..session import results
from ..session.scene_result import SceneResult
from ..session.staleness import look_soon
from ..settings.job_settings import TABLE, changed, rows
from ..settings.named import named_settings

if TYPE_CHECKING:

    class PanelBase(bpy.types.Panel):
        """Base of mixins for panels."""
else:
    PanelBase = object  # Blender requires its own class among the direct bases of each panel

# Unscaled text in panels: size in points, width of tabs and frames of a region, and width of an icon.
_POINTS, _MARGIN_PX, _ICON_PX = 11.0, 74.0, 20.0
# How to update an outdated step, and the name of its settings.
_STALE = {"surface": ("voxelize", "octree"), "light": ("bake", "light"), "view": ("render", "view")}
_MOST_NOTES = 5
# `bl_order` of sub-panels: the steps of a preview come first, then the overlay, then what follows a preview.
OVERLAY, LAST = 1, 2


class Tab(PanelBase):
    """Panel of the sidebar tab."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "PatchNet"


class SubPanel(Tab):
    """Panel below the first one, closed at first."""

    bl_parent_id = "PATCHNET_PT_main"
    bl_options = {"DEFAULT_CLOSED"}


def draw_notes(layout: bpy.types.UILayout, context: bpy.types.Context, notes: Sequence[str], of: str) -> None:
    """Draw notes below a collapsible heading; nothing without notes. of: name of the subject of the notes."""
    if not notes:
        return
    header, body = layout.panel(f"PATCHNET_notes_{of}")
    header.label(text=counted(len(notes), "Note"), icon="INFO")
    if body is None:
        return
    notes = sorted(notes, key=lambda text: not named_settings(text))  # notes with buttons first
    for text in notes[:_MOST_NOTES]:
        draw_remedy(body.box(), context, text, "NONE")
    if len(notes) > _MOST_NOTES:
        draw_sentence(body, context, f"and {len(notes) - _MOST_NOTES} more in the Info log")
    if any("Refine with Cycles" in text for text in notes[:_MOST_NOTES]):
        body.operator("patchnet.refine_with_cycles", icon="RENDER_STILL").cycles_light = COMBINED


def draw_remedy(layout: bpy.types.UILayout, context: bpy.types.Context, text: str, icon: str) -> None:
    """Draw a sentence, and a button for each setting that it names, unless the setting has that value already."""
    draw_sentence(layout, context, text, icon)
    for words, (row, value) in named_settings(text).items():
        if getattr(context.scene.patchnet, row.name) != value:
            button = layout.operator(f"wm.context_set_{'enum' if row.kind is Kind.CHOICE else 'boolean'}", text=words)
            button.data_path, button.value = f"scene.patchnet.{row.name}", value


def split(layout: bpy.types.UILayout) -> bpy.types.UILayout:
    """Layout with names left and values right, as in Blender's own panels."""
    layout.use_property_split = True
    layout.use_property_decorate = False
    return layout


def draw_settings(
    layout: bpy.types.UILayout, values: bpy.types.PropertyGroup, *stages: str, place: Place = Place.OWN
) -> None:
    """Draw the settings of some stages at a place in panels that have an effect now."""
    for row in rows(*stages):
        if row.place is place and row.counts(values):
            draw_setting(layout, values, row.name)


def draw_advanced(layout: bpy.types.UILayout, values: bpy.types.PropertyGroup, stage: str) -> None:
    """Draw the rarely changed settings of a stage below a heading that is closed by default."""
    header, body = layout.panel(f"PATCHNET_advanced_{stage}", default_closed=True)
    header.label(text="Advanced")
    if body is not None:
        draw_settings(split(body), values, stage, place=Place.ADVANCED)


def draw_setting(layout: bpy.types.UILayout, values: bpy.types.PropertyGroup, name: str) -> None:
    """Draw a setting by its kind: a list of images, sides in pixels, a checkbox where 0 is automatic.

    It is grayed out while another one takes its place.
    """
    row = TABLE[name]
    if not row.active(values):
        layout = layout.row()
        layout.active = False
    if name == "importance_image":
        layout.prop_search(values, name, bpy.data, "images")
    elif name == "size":
        column, empty = layout.column(align=True), row.automatic if any(values.size) else "As Render"
        draw_automatic(column, values, "size_x", "Picture Size X", empty)
        draw_automatic(column, values, "size_y", "Y", empty)
    elif name == "strategy":
        layout.prop(values, "short_strategy")
    elif row.kind in (Kind.AUTOMATIC, Kind.PAIR):
        draw_automatic(layout, values, name, row.label, row.automatic)
    else:
        icon = "CAMERA_DATA" if row.stage == CAMERAS else "NONE"
        layout.prop(values, name, placeholder=row.automatic, icon=icon)


def draw_automatic(
    layout: bpy.types.UILayout, values: bpy.types.PropertyGroup, name: str, label: str, automatic: str
) -> None:
    """Draw a checkbox, and the number if it is on, else the automatic value."""
    row = layout.row(heading=label)
    row.prop(values, f"use_{name}", text="")
    if getattr(values, f"use_{name}"):
        row.prop(values, name, text="")
    else:
        row.label(text=automatic)


def draw_sentence(
    layout: bpy.types.UILayout, context: bpy.types.Context, text: str, icon: str = "NONE", share: float = 1.0
) -> None:
    """Draw a text wrapped to a share of the region's width, the first line with an icon."""
    region, scale = context.region, context.preferences.system.ui_scale  # which is 0 without a window
    column = layout.column(align=True)
    taken = (_MARGIN_PX + (_ICON_PX if icon != "NONE" else 0.0)) * scale
    for line in [text] if region is None or not scale else _lines(text, (region.width - taken) * share, scale):
        column.label(text=line, icon=icon)
        icon = "NONE" if icon == "NONE" else "BLANK1"


def _lines(text: str, width: float, scale: float) -> list[str]:
    """Wrap a text into lines of at most `width` pixels; only a single word may be wider."""
    blf.size(0, _POINTS * scale)
    lines: list[str] = []
    for word in text.split(" "):
        if lines and blf.dimensions(0, f"{lines[-1]} {word}")[0] <= width:
            lines[-1] += f" {word}"
        else:
            lines.append(word)
    return lines


def draw_progress(layout: bpy.types.UILayout, job: JobDisplay) -> None:
    """Draw the job's progress, or its step if progress is unknown, and how to stop it."""
    layout.progress(factor=job.whole or 0.0, text=f"{job.title if job.whole else job.progress.label}: Esc stops")


def draw_stale(layout: bpy.types.UILayout, context: bpy.types.Context, *steps: str) -> None:
    """Draw why results are out of date, and what to do, for steps of "surface", "light", "view"."""
    result = results.result_of(context.scene)
    if result is not None:
        look_soon()
        for text in filter(None, (stale_text(result, context.scene, step) for step in steps)):
            draw_sentence(layout, context, text, "ERROR")


def stale_text(result: SceneResult, scene: bpy.types.Scene, step: str) -> str:
    """Why a step is out of date, and what to do, or ""."""
    remedy, settings = _STALE[step]
    why = result.why(step) or changed_text(scene.patchnet, result.made_with.get(settings), settings)
    return f"{why[:1].upper()}{why[1:]}: {remedy} again" if why else ""


def changed_text(values: bpy.types.PropertyGroup, before: dict[str, object] | None, *steps: str) -> str:
    """Name the setting of some steps that has changed, or ""; before: None if no result was made with them."""
    name = changed(values, before, *steps) if before is not None else ""
    return f"'{name}' changed" if name else ""
