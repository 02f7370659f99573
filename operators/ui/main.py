# SPDX-License-Identifier: GPL-3.0-or-later
"""First panel: basic settings, one button for the whole job, the estimate; export, statistics."""

from __future__ import annotations

import bpy

from ...patchnet_addon.export.vdb import vdb_module_name
from ...patchnet_addon.runtime.quantities import bytes_text, counted
from ..jobs.job_operator import job_in_window
from ..scene_access.images import PICTURES
from ..schema.setting import Place
from ..schema.values import JOB
from ..session import results
from ..session.scene_session import held, session_of
from ..session.staleness import PERHAPS
from ..session.views import shown_pictures
from ..settings.job_settings import ESTIMATED
from . import tab
from .presets_menu import PATCHNET_PT_presets

_MOST_CAMERAS = 3
_TITLES = {"overlay": "Refined First"}  # of pictures; not the sub-panel Overlay


class PATCHNET_PT_main(tab.Tab, bpy.types.Panel):
    """The whole job in one click, and its estimate."""

    bl_label = "PatchNet"

    def draw_header_preset(self, _context: bpy.types.Context) -> None:
        """Draw the menu of presets."""
        PATCHNET_PT_presets.draw_panel_header(self.layout)

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the button, or progress in its place, so that the buttons below stay where they are."""
        layout = tab.split(self.layout)
        values = context.scene.patchnet
        tab.draw_settings(layout, values, *JOB, place=Place.FIRST)
        row = layout.row()
        row.scale_y = 1.5
        job = job_in_window()
        if job.display is not None:
            tab.draw_progress(row, job.display)
        else:
            row.operator("patchnet.run_all", icon="PLAY")
            layout.operator("patchnet.fly_through", icon="RENDER_ANIMATION")
        result = results.result_of(context.scene)
        running = job.title == "Preview Selection"
        if result is not None and (text := results.unfinished_text(result, running=running)):
            tab.draw_sentence(layout, context, text, "INFO")
        _draw_pictures(layout, context)
        notes = [] if result is None else result.all_notes
        tab.draw_notes(layout, context, notes, "result")
        layout.operator("patchnet.estimate", icon="INFO")
        _draw_estimate(layout, context, notes)
        tab.draw_stale(layout, context, "surface", "light")  # of the view beside its button, in Preview


def _draw_pictures(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw a button for each picture, camera by camera."""
    cameras = shown_pictures()
    for camera, names in list(cameras.items())[:_MOST_CAMERAS]:
        column = layout.column(align=True)
        if len(cameras) > 1:
            column.label(text=camera, icon="CAMERA_DATA")
        grid = column.grid_flow(row_major=True, columns=2, even_columns=True, align=True)
        for what in sorted(names, key=[*PICTURES, *names].index):  # others come last
            text = _TITLES.get(what, what.title())
            grid.operator("patchnet.show_picture", text=text, icon="IMAGE_DATA").image = names[what]
    if len(cameras) > _MOST_CAMERAS:
        more = len(cameras) - _MOST_CAMERAS
        tab.draw_sentence(layout, context, f"Image Editors list those of {counted(more, 'other camera')}")


def _draw_estimate(layout: bpy.types.UILayout, context: bpy.types.Context, said: list[str]) -> None:
    """Draw the last estimate, what it was made for, and its notes but those that were `said`."""
    scene = context.scene
    found = session_of(scene).estimate
    if found is None:
        return
    header, body = layout.panel("PATCHNET_estimate")
    header.label(text="Estimate")
    if body is None:
        return
    box = body.box().column(align=True)
    why = tab.changed_text(scene.patchnet, found.settings, *ESTIMATED) or (PERHAPS if found.outdated else "")
    if why:
        tab.draw_sentence(box, context, f"Estimate again: {why}", "ERROR")
    for line in found.made_for:
        tab.draw_sentence(box, context, line)
    for line in found.lines:
        row = box.row()
        row.active = not why
        tab.draw_sentence(row, context, line)
    if found.too_large:
        tab.draw_sentence(box, context, "Does not fit into memory", "ERROR")
    tab.draw_notes(layout, context, [text for text in found.notes if text not in said], "estimate")


class PATCHNET_PT_statistics(tab.SubPanel, bpy.types.Panel):
    """Size, time and errors of the result."""

    bl_label = "Statistics"
    bl_order = tab.LAST

    def draw(self, context: bpy.types.Context) -> None:
        """Lines of the last step, memory in use, and the button that frees it."""
        layout = tab.split(self.layout)
        result = results.result_of(context.scene)
        if result is None:
            tab.draw_sentence(layout, context, "Nothing computed yet")
            return
        taken = held()
        column = layout.column(align=True)
        for line in result.summary:
            tab.draw_sentence(column, context, line)
        memory = f"In memory: {bytes_text(taken.results)}, pictures {bytes_text(taken.images)}"
        tab.draw_sentence(layout, context, memory)
        layout.operator("patchnet.clear_results", icon="TRASH")


class PATCHNET_PT_export(tab.SubPanel, bpy.types.Panel):
    """Display and export of voxels."""

    bl_label = "Show and Export"
    bl_order = tab.LAST

    def draw(self, context: bpy.types.Context) -> None:
        """Draw settings, the two buttons, and formats that this Blender cannot write."""
        layout = tab.split(self.layout)
        tab.draw_automatic(layout, context.scene.patchnet, "level", "Level", "Finest")
        layout.prop(context.scene.patchnet, "limit")
        layout.operator("patchnet.show_voxels", icon="MESH_CUBE")
        layout.operator("patchnet.export_octree", icon="EXPORT")
        if not vdb_module_name():  # looked for once
            tab.draw_sentence(layout, context, "This Blender cannot write .vdb", "INFO")
