# SPDX-License-Identifier: GPL-3.0-or-later
"""Operator that loads an octree file as the voxels of the scene."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import bpy
from bpy.props import StringProperty

from ..patchnet_addon.process.computed import computed
from ..patchnet_addon.runtime.errors import SettingError
from ..patchnet_addon.runtime.progress import Progress, Steps
from ..patchnet_addon.runtime.quantities import counted
from .computing.files import loaded_files
from .jobs.job_operator import JobOperator, tell
from .properties.job import absolute_path
from .properties.stages import properties_of
from .schema.values import CODES
from .session.keep import keep
from .session.scene_result import SceneResult
from .session.staleness import look_again
from .settings.job_settings import JobSettings
from .state.watch import read_state

if TYPE_CHECKING:
    from ..patchnet_addon.codes.coded_octree import CodedOctree
    from ..patchnet_addon.octree.octree import Octree
    from .state.scene_state import SceneState

_OTHER = "the file was made of another scene, or of this one before it was changed"


class PATCHNET_OT_load_octree(JobOperator, bpy.types.Operator):
    """Load the voxels of an octree file into this scene, and its look-ahead if that file is beside it"""

    bl_idname = "patchnet.load_octree"
    bl_label = "Load Octree"
    __annotations__ = properties_of(CODES)

    filepath: StringProperty(
        name="File",
        description="An octree, ends in .safetensors",
        subtype="FILE_PATH",
        options={"PATH_SUPPORTS_BLEND_RELATIVE"},
    )
    filter_glob: StringProperty(default="*.safetensors", options={"HIDDEN"})
    _asked = False

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask for the file."""
        if bpy.app.background or self.filepath:
            return super().invoke(context, event)
        self._asked = True
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Load now, or start loading with progress after the file browser."""
        if not self._asked or not self.filepath:
            return super().execute(context)
        bpy.ops.patchnet.load_octree("INVOKE_DEFAULT", filepath=self.filepath)
        return {"FINISHED"}

    def steps(self, context: bpy.types.Context, settings: JobSettings) -> Steps[str]:
        """Open the files, compare them with the scene, keep them."""
        from ..patchnet_addon.network.weights import load_weights

        path = absolute_path(self.filepath)
        if path is None:
            raise SettingError("No file to load: choose an octree file, which ends in .safetensors")
        weights = load_weights(settings.network.weights)
        loading = Progress(0, 1, "Loading the octree")
        octree, coded, problem = yield from computed(loaded_files, path, weights, at=loading)
        yield Progress(0, 1, "Looking at the scene")
        state = yield from read_state(context.scene)
        made = _result(octree, coded, state, context.scene)
        keep(context.scene, made)
        if problem:
            tell(self, "WARNING", problem)
        if made.stale:
            tell(self, "WARNING", f"{path.name} does not fit the scene: {made.why(min(made.stale))}")
        more = ", with look-ahead" if coded else ""
        return f"{path.name}: {counted(octree.leaf_count, 'voxel')}, depth {octree.depth}{more}"


def _result(octree: Octree, coded: CodedOctree | None, state: SceneState, scene: bpy.types.Scene) -> SceneResult:
    """Result of an octree's file; a file without the state of a scene counts as fitting."""
    from .schema.values import VISIBLE

    provenance = octree.provenance
    state = replace(state, gloss_from=str(provenance.get("gloss_from", "")))
    made = SceneResult(
        octree,
        str(provenance.get("scope", VISIBLE)),
        light=str(provenance.get("light", "none")),
        coded=coded,
        state=state,
    )
    if provenance.get("scene_state", state.identity()) != state.identity():
        made.state = None  # no comparison is possible
        for step in ("surface", "light"):
            made.mark(step, _OTHER)
    else:
        look_again(made, scene)  # from the camera of the gloss
    return made


def _draw_in_menu(menu: bpy.types.Menu, _context: bpy.types.Context) -> None:
    menu.layout.operator(PATCHNET_OT_load_octree.bl_idname, text="PatchNet Octree (.safetensors)")


MENUS = (("TOPBAR_MT_file_import", _draw_in_menu),)
