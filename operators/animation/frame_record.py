# SPDX-License-Identifier: GPL-3.0-or-later
"""Record in a frame's folder of the files that were made, and keys that tell whether they would be made alike now."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import bpy

from ...patchnet_addon.runtime.file_kinds import FRAME_RECORD
from ...patchnet_addon.runtime.outputs import identities, identity
from ...patchnet_addon.runtime.source_hash import source_hash
from ..pipeline.reports import is_inside, write_json
from ..scene.fingerprint import SceneFingerprint, composed
from ..state.digest import Digest

RECORD_NAME = "frame.json"
# What makes results, and what it imports; a worker is a program of its own.
_CODE = (
    "operators.animation.animation", "operators.animation.frame_maker",
    "operators.pipeline.run", "operators.voxelize_objects", "operators.bake_light", "operators.precompute_codes",
    "operators.load_octree", "patchnet_addon.network.torch_worker",
)  # fmt: skip


@dataclass(frozen=True)
class FrameRecord:
    """Record of a finished frame.

    content: `content_key`. file: `file_key`, or "" where no file is known to hold the scene.
    files: bytes of each file by its path in the folder. summary: figures for the report of the animation.
    """

    frame: int
    content: str
    file: str
    files: dict[str, int]
    summary: dict[str, Any]


def frame_folder(out: Path, frame: int) -> Path:
    """Folder of a frame's files: frame-0001 and so on."""
    return out / f"frame-{frame:04d}"


def files_in(folder: Path) -> dict[str, int]:
    """Bytes of all files in a folder, by their paths in it."""
    return {
        path.relative_to(folder).as_posix(): path.stat().st_size for path in sorted(folder.rglob("*")) if path.is_file()
    }


def read_record(folder: Path) -> FrameRecord | None:
    """Read the record of the frame in `folder`, or None if it is not there as a whole."""
    try:
        record = FrameRecord(**json.loads((folder / RECORD_NAME).read_text(encoding="utf-8")))
        there = all((folder / name).stat().st_size == size for name, size in record.files.items())
    except (OSError, ValueError, TypeError, AttributeError):
        return None
    return record if there and record.files and isinstance(record.summary, dict) else None


def write_record(folder: Path, record: FrameRecord) -> None:
    """Record that the frame is finished, from now on; raises OutputError if it cannot be written."""
    write_json(folder / RECORD_NAME, asdict(record), FRAME_RECORD)


def discard(folder: Path, inputs: Iterable[Path]) -> None:
    """Take away what an earlier frame left in `folder`, its note first, so that nothing of it is taken for new.

    Files that it did not write stay, and those of `inputs`. Raises OSError.
    """
    record, keep = read_record(folder), identities(inputs)
    (folder / RECORD_NAME).unlink(missing_ok=True)
    for name in record.files if record else ():
        if is_inside(name) and identity(folder / name) not in keep:
            (folder / name).unlink(missing_ok=True)
    for path in sorted(folder.glob("*/"), reverse=True):
        if path.is_dir() and not any(path.iterdir()):
            path.rmdir()


def content_key(context: bpy.types.Context, scope: str, settings: str) -> str:
    """32 hex digits over settings and all of the scene, as it is at its present frame, that a frame's files depend on.

    It sees changes that were not saved, and no change where only other frames differ. Which machine computes does not
    count. What the fingerprint does not see is not seen here. Raises as `read_scene` does.
    """
    surface = SceneFingerprint(context.evaluated_depsgraph_get()).surface(scope)
    scene = SceneFingerprint(context.evaluated_depsgraph_get())  # reading may have evaluated anew
    return composed(code_hash(), bpy.app.version_string, settings, surface, scene.scene(), scene.cameras())


def file_key(scene_file: Path, settings: str, frame: int) -> str:
    """32 hex digits over settings, frame, and size and time of a .blend file that is open and of all that it names.

    Quicker than `content_key`: equal keys mean an equal frame, others mean nothing.
    """
    digest = Digest()
    digest.text(code_hash(), bpy.app.version_string, settings, frame)
    for path in (str(scene_file.absolute()), *sorted(bpy.utils.blend_paths(absolute=True))):
        digest.file(path)
    return digest.hexdigest()


@cache
def code_hash() -> str:
    """Hash of the code that makes results: another version does not mix its results with those of this one."""
    return source_hash(*_CODE)
