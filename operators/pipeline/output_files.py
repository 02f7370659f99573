# SPDX-License-Identifier: GPL-3.0-or-later
"""Output files of a job, and its input files, which are never replaced."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import bpy

from ...patchnet_addon.network.weights import default_weights_path
from ...patchnet_addon.runtime.file_kinds import CODES, EXR, OCTREE, PNG, REPORT, FileKind
from ...patchnet_addon.runtime.outputs import check_outputs
from ..scene_access.images import OF_REFERENCE, PICTURES, PRIORITY_NAME
from ..settings.cycles_settings import CyclesSettings
from ..settings.job_settings import JobSettings
from .cycles_pictures import cycles_file_names
from .reports import REPORT_NAME

OCTREE_NAME, CODES_NAME, OVERVIEW_NAME = "octree.safetensors", "codes.safetensors", "overview.png"


def job_files(folders: Iterable[str], cycles: CyclesSettings | None, *, reference: bool = False) -> dict[str, FileKind]:
    """Kind of each file of a job by its path in the output folder; `folders` are those of the cameras.

    reference: whether views have one, and pictures of errors.
    """
    files = {OCTREE_NAME: OCTREE, CODES_NAME: CODES, OVERVIEW_NAME: PNG, REPORT_NAME: REPORT}
    pictures = [name for name in PICTURES if reference or name not in OF_REFERENCE]
    names = [f"{name}.png" for name in pictures] + (cycles_file_names(cycles.compare) if cycles is not None else [])
    for folder in folders:
        files |= {f"{folder}/{name}": PNG for name in names} | {f"{folder}/{PRIORITY_NAME}": EXR}
    return files


def job_inputs(settings: JobSettings) -> list[Path]:
    """Files that a job reads: those of the open scene, weights, and a painted mask."""
    importance = settings.view.importance
    mask = importance.file if importance is not None else None
    return [*scene_inputs(), settings.network.weights or default_weights_path(), *([] if mask is None else [mask])]


def scene_inputs() -> Iterator[Path]:
    """Files of the scene: the open file, and all that it names, such as images, libraries and caches."""
    if bpy.data.filepath:
        yield Path(bpy.data.filepath)
    yield from map(Path, bpy.utils.blend_paths(absolute=True))


def check_job(settings: JobSettings, scene: Path | None, *, frames: bool) -> None:
    """Raise OutputError for results that cannot be written, as far as that is known before a scene is opened.

    scene: the file that will be opened. frames: results are frames in folders of their own.
    """
    assert settings.out is not None
    files = {REPORT_NAME: REPORT} if frames else job_files((), settings.view.cycles)
    inputs = [*job_inputs(settings), *([] if scene is None else [scene])]
    check_outputs({settings.out / name: kind for name, kind in files.items()}, inputs, folder=settings.out)
