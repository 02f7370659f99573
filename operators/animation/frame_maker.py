# SPDX-License-Identifier: GPL-3.0-or-later
"""Maker of the files of one frame by the whole job, and records of frames."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import bpy

from ...patchnet_addon.network.weights import load_weights
from ...patchnet_addon.runtime.file_kinds import FileKind
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.sampling.report import has_errors
from ..importance.pixels import importance_key
from ..pipeline.lit_octree import cameras_key
from ..pipeline.output_files import job_files, job_inputs, view_folders
from ..pipeline.run import Before, JobResult, run_job, write_result
from ..pipeline.voxels_key import code_hash, surface_key, voxels_key
from ..scene.cameras import AUTO, camera_name
from ..scene.fingerprint import cameras_hash, surface_hash
from ..scene.read import read_scene
from ..session.job_voxels import before_again, before_on_disk, result_of_job, voxels_before
from ..session.octree_cache import keep_on_disk
from ..settings.job_settings import JobSettings
from ..state.digest import composed
from ..state.scene_state import scene_state

RECORD_NAME = "frame.json"


@dataclass(frozen=True)
class FrameRecord:
    """Record of a finished frame.

    content: `content_key`. files: bytes of each file by its path in the folder. summary: figures for the report of the
    animation.
    """

    frame: int
    content: str
    files: dict[str, int]
    summary: dict[str, Any]


def frame_folder(out: Path, frame: int) -> Path:
    """Folder of a frame's files: frame-0001 and so on."""
    return out / f"frame-{frame:04d}"


def read_record(folder: Path) -> FrameRecord | None:
    """Read the record of the frame in `folder`; None if a file is missing."""
    try:
        record = FrameRecord(**json.loads((folder / RECORD_NAME).read_text(encoding="utf-8")))
        there = all((folder / name).stat().st_size == size for name, size in record.files.items())
    except (OSError, ValueError, TypeError, AttributeError):
        return None
    return record if there and record.files and isinstance(record.summary, dict) else None


def content_key(context: bpy.types.Context, scope: str, settings: str) -> str:
    """32 hex digits over settings and all of the scene, as it is at its present frame, that a frame's files depend on.

    Unsaved changes count; changes of other frames and the machine do not, nor do simulations that are not baked. Raises
    as `read_scene` does.
    """
    surface = surface_hash(read_scene(context.evaluated_depsgraph_get(), scope))
    state = scene_state(context.scene, keys=False).identity(context.scene.frame_current)
    cameras = cameras_hash(context.evaluated_depsgraph_get())  # reading may have evaluated it again
    return composed(code_hash(), bpy.app.version_string, settings, surface, state, cameras)


class JobMaker:
    """Maker of frames by the whole job, as `patchnet run`; the scene is at the frame when a method is called.

    A frame with the surface and light of the last one has its voxels, or of the one that most frames had so far.

    settings: without the folder. track: key of the cameras of all frames that voxels are fitted to, "" for those of a
    frame.
    """

    def __init__(self, settings: JobSettings) -> None:
        """Load the weights; raises WeightsFileError."""
        weights, painted = load_weights(settings.network.weights), importance_key(settings.view.importance)
        self.settings, self._wanted = replace(settings, out=None), f"{weights.whole_hash} {painted}"
        self.track = ""
        self._kept: list[_Made] = []

    def shared_settings(self, context: bpy.types.Context) -> JobSettings:
        """Settings of all frames, whose voxels follow the cameras if they shall; automatic cameras are fixed."""
        settings = self.settings
        if settings.surface.track and list(settings.view.cameras) != [AUTO]:
            self.track = cameras_key(context, settings)
        return settings.changed(track=bool(self.track))

    def settings_text(self, settings: JobSettings) -> str:
        """Text of all settings that a frame's files depend on; weights and importance by their contents."""
        return f"{settings.changed(weights=None)!r} {self._wanted} {self.track}"

    def files(self, context: bpy.types.Context) -> dict[str, FileKind]:
        """Kind of each file of any frame, by its path in the frame's folder; raises SceneError.

        Pictures are of the named cameras, or of all cameras that are active at some frame.
        """
        wanted, scene = self.settings.view, context.scene
        active = [scene.camera, *(marker.camera for marker in scene.timeline_markers)]
        names = [name for camera in active if (name := camera_name(scene, camera))]
        folders = view_folders(scene, wanted.cameras or names).values()
        return job_files(folders, wanted.cycles, reference=wanted.has_reference)

    def inputs(self) -> list[Path]:
        """Input files, which are never replaced."""
        return job_inputs(self.settings)

    def make(self, context: bpy.types.Context, settings: JobSettings, folder: Path) -> Steps[dict[str, Any]]:
        """Write the frame's files into `folder`; return its summary, with "exposure" and "warnings"."""
        graph, wanted = context.evaluated_depsgraph_get(), settings.changed(exposure=self.settings.light.exposure)
        cameras = self.track or cameras_key(context, wanted)
        key = voxels_key(graph, wanted, surface_key(graph, wanted), cameras)
        there = next((each for each in self._kept if each.key == key), None)
        # Others are freed, but for one that several frames had: what moves may come back.
        shared = [each for each in self._kept if each is not there and each.frames > 1]
        self._kept = [max(shared, key=lambda each: each.frames)] if shared else []
        own_key = key if settings == wanted else composed(key, settings.light.exposure)
        before = _found(context, settings, wanted, key, own_key) if there is None else there.before
        result = yield from run_job(context, settings, before=before)
        if before is None or not before.lit:
            keep_on_disk(context.scene, result_of_job(context, settings, result, own_key), apart=True)
        made = _Made(key, before_again(result), 1 if there is None else there.frames + 1)
        self._kept.append(made)
        yield Progress(0, 1, "Writing files")
        write_result(folder, result)
        return _summary(result) | {"voxels_of": result.coded.octree.provenance["frame"]}


def _found(
    context: bpy.types.Context, settings: JobSettings, wanted: JobSettings, key: str, own_key: str
) -> Before | None:
    """Voxels of the cache folder in the exposure of the settings, which may be another one than is wanted."""
    before, exposure = voxels_before(context, wanted, key), settings.light.exposure
    if before is not None and exposure not in (None, before.octree.exposure):
        before = None
    return before if own_key == key or before is not None else before_on_disk(context, settings, own_key)


@dataclass(frozen=True, eq=False)
class _Made:
    """Voxels of a frame. key: of all that they depend on. frames: number of those that had them."""

    key: str
    before: Before
    frames: int


def _summary(result: JobResult) -> dict[str, Any]:
    """Figures of a frame that the report of the animation repeats."""
    report = result.report
    return {
        "exposure": result.coded.octree.exposure,
        "octree": report["octree"],
        "views": [_view_summary(view, report["strategy"]) for view in report["frames"]],
        "seconds": sum(report["timings_s"].values()),
        "warnings": list(result.warnings),
    }


def _view_summary(view: dict[str, Any], strategy: str) -> dict[str, Any]:
    names: Sequence[str] = ("camera", "folder", "size", "lookahead_share", "unrefined", "refined")
    found = {name: view[name] for name in names}
    if not has_errors(view):
        return found
    predicted = {"mse_unrefined": view["predicted"]["mse_unrefined"], "mse": view["predicted"]["mse"][strategy]}
    errors = {"mse_unrefined": view["mse_unrefined"], "mse": view["mse"][strategy], "predicted": predicted}
    return found | errors
