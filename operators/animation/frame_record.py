# SPDX-License-Identifier: GPL-3.0-or-later
"""Record of the files in a frame's folder, with a key that tells whether they are up to date."""

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

RECORD_NAME = "frame.json"
# Modules that make results; their imports count, too.
_CODE = (
    "operators.animation.animation", "operators.animation.frame_maker",
    "operators.pipeline.run", "operators.voxelize_objects", "operators.bake_light", "operators.precompute_codes",
    "operators.load_octree",
)  # fmt: skip


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


def files_in(folder: Path) -> dict[str, int]:
    """Bytes of all files in a folder, by their paths in it."""
    return {
        path.relative_to(folder).as_posix(): path.stat().st_size for path in sorted(folder.rglob("*")) if path.is_file()
    }


def read_record(folder: Path) -> FrameRecord | None:
    """Read the record of the frame in `folder`; None if a file is missing."""
    try:
        record = FrameRecord(**json.loads((folder / RECORD_NAME).read_text(encoding="utf-8")))
        there = all((folder / name).stat().st_size == size for name, size in record.files.items())
    except (OSError, ValueError, TypeError, AttributeError):
        return None
    return record if there and record.files and isinstance(record.summary, dict) else None


def write_record(folder: Path, record: FrameRecord) -> None:
    """Write the record of a finished frame; raises OutputError."""
    write_json(folder / RECORD_NAME, asdict(record), FRAME_RECORD)


def discard(folder: Path, inputs: Iterable[Path]) -> None:
    """Remove the files of an earlier frame from `folder`, its record first.

    Other files and those of `inputs` stay. Raises OSError.
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

    Unsaved changes count; changes of other frames and the machine do not. It has the limits of the fingerprint. Raises
    as `read_scene` does.
    """
    surface = SceneFingerprint(context.evaluated_depsgraph_get()).surface(scope)
    scene = SceneFingerprint(context.evaluated_depsgraph_get())  # reading may have evaluated it again
    return composed(code_hash(), bpy.app.version_string, settings, surface, scene.scene(), scene.cameras())


@cache
def code_hash() -> str:
    """Hash of the code that makes results, so that versions do not mix their results."""
    return source_hash(*_CODE)
