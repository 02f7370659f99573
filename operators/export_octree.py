# SPDX-License-Identifier: GPL-3.0-or-later
"""Operator that exports one level of the octree as a file for other programs."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty

from ..patchnet_addon.runtime.progress import Steps
from ..patchnet_addon.runtime.quantities import counted
from .jobs.job_operator import VoxelJob
from .properties.job import absolute_path, setting
from .properties.stages import LevelProperties
from .session import results
from .settings.job_settings import JobSettings

_FORMATS = [
    (".ply", "Point Cloud (.ply)", "Centers, normals, colors, luminance and sides of the voxels"),
    (".vdb", "OpenVDB (.vdb)", "Grids of luminance and density; needs a Blender with the openvdb module"),
    (".safetensors", "Octree (.safetensors)", "The octree down to the level, as PatchNet reads it"),
]


class PATCHNET_OT_export_octree(LevelProperties, VoxelJob, bpy.types.Operator):
    """Write the voxels of one level to a file; its ending chooses the format"""

    bl_idname = "patchnet.export_octree"
    bl_label = "Export Voxels"

    filepath: StringProperty(
        name="File",
        description="Ends in .ply, .vdb or .safetensors",
        subtype="FILE_PATH",
        options={"PATH_SUPPORTS_BLEND_RELATIVE"},
    )
    format: EnumProperty(name="Format", items=_FORMATS, default=".ply", options={"SKIP_SAVE"})
    filter_glob: StringProperty(default=";".join(f"*{ending}" for ending, *_ in _FORMATS), options={"HIDDEN"})
    check_existing: BoolProperty(default=True, options={"HIDDEN"})
    ask: BoolProperty(
        name="Ask", description="Open the file browser first", default=True, options={"HIDDEN", "SKIP_SAVE"}
    )
    _asked = False

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask for the file, then export with progress in the window."""
        if bpy.app.background or not self.ask:
            return super().invoke(context, event)
        if not self.filepath:
            self.filepath = f"{Path(bpy.data.filepath).stem or 'voxels'}{self.format}"
        self.format = self._ending() or self.format
        self.level = setting(context, self, "level")
        self._shown, self._asked = self.format, True
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def check(self, _context: bpy.types.Context) -> bool:
        """Match format and ending in the file browser: a change of one changes the other."""
        before = (self.filepath, self.format)
        if self.format == self._shown and self._ending():
            self.format = self._ending()
        elif Path(self.filepath).name:
            path = Path(self.filepath)
            self.filepath = str(path.with_suffix(self.format) if self._ending() else f"{path}{self.format}")
        self._shown = self.format
        return (self.filepath, self.format) != before

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Export now, or start the export with progress after the file browser."""
        if not self._asked:
            return super().execute(context)
        level = setting(context, self, "level")
        try:
            bpy.ops.patchnet.export_octree("INVOKE_DEFAULT", filepath=self.filepath, level=level, ask=False)
        except RuntimeError as error:
            self.report({"ERROR"}, str(error).strip().removeprefix("Error: "))
            return {"CANCELLED"}
        return {"FINISHED"}

    def steps(self, context: bpy.types.Context, settings: JobSettings) -> Steps[str]:
        """Write the file."""
        from ..patchnet_addon.export.formats import export_octree, format_of
        from ..patchnet_addon.runtime.errors import SettingError
        from ..patchnet_addon.runtime.outputs import check_outputs
        from .pipeline.output_files import scene_inputs

        octree = results.voxels_of(context.scene).octree
        level = setting(context, self, "level") or octree.depth
        path = absolute_path(self.filepath)
        if path is None:
            raise SettingError("No file to write: choose a path that ends in .ply, .vdb or .safetensors")
        check_outputs({path: format_of(path).kind}, scene_inputs(), makes_folders=False)
        self._file = path
        count = yield from export_octree(octree, path, level)
        return f"{path.name}: {counted(count, 'voxel')} of level {level}"

    def _ending(self) -> str:
        """Format by the file's ending, or ""."""
        ending = Path(self.filepath).suffix.lower()
        return ending if ending in [name for name, *_ in _FORMATS] else ""
