# SPDX-License-Identifier: GPL-3.0-or-later
"""File kinds by content: output never replaces a file of another kind.

An ending is not enough: users mistype paths, and `.json`, `.png` or `.safetensors` files may belong to any program.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

_MAX_HEADER_BYTES = 16 << 20
_MAX_TEXT_BYTES = 64 << 20
_RECORD_BEGINS = b'{\n  "frame": '
_COMPRESSED = (b"\x28\xb5\x2f\xfd", b"\x1f\x8b")  # zstd and gzip, as Blender compresses its files


@dataclass(frozen=True)
class FileKind:
    """Kind of files.

    title: its name with article. endings: endings of file names. holds: test of a file's content; raises OSError, and
    ValueError, TypeError or KeyError for other kinds.
    """

    title: str
    endings: tuple[str, ...]
    holds: Callable[[Path], bool]

    def is_at(self, path: Path) -> bool:
        """Test whether the file at `path` is of this kind; empty files with its ending are. Raises OSError."""
        if path.stat().st_size == 0:
            return path.suffix.lower() in self.endings
        try:
            return self.holds(path)
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError, zipfile.BadZipFile):
            return False


@cache
def arrays_kind(kind: str) -> FileKind:
    """Kind of PatchNet array files (`files.py`), such as "octree"; damaged files count if their header is readable."""
    return FileKind(f"{with_article(kind)} file of PatchNet", (".safetensors",), lambda path: arrays_in(path) == kind)


def with_article(word: str) -> str:
    """Word after its article."""
    return f"{'an' if word[0] in 'aeio' else 'a'} {word}"


def arrays_in(path: Path) -> str:
    """Kind of a PatchNet array file, "" for files of other programs; raises as `FileKind.holds`."""
    with path.open("rb") as file:
        length = int.from_bytes(file.read(8), "little")
        own = json.loads(file.read(length))["__metadata__"] if length <= _MAX_HEADER_BYTES else {}
    return str(own["kind"]) if own.get("format") == "patchnet" else ""


def _begins(*beginnings: bytes) -> Callable[[Path], bool]:
    return lambda path: _head(path, max(map(len, beginnings))).startswith(beginnings)


def _head(path: Path, length: int) -> bytes:
    with path.open("rb") as file:
        return file.read(length)


def _json(path: Path) -> Any:
    return json.loads(_head(path, _MAX_TEXT_BYTES))


def _is_report(path: Path) -> bool:
    return "patchnet" in _json(path)["versions"].keys()  # noqa: SIM118  a text has none


def _is_frame_record(path: Path) -> bool:
    """Test for a frame's record; a truncated one counts, so that it does not block its frame."""
    head = _head(path, len(_RECORD_BEGINS))
    return _RECORD_BEGINS.startswith(head) or {"frame", "content", "file", "files", "summary"} <= _json(path).keys()


def _is_log(path: Path) -> bool:
    first = json.loads(_head(path, 1 << 16).splitlines()[0]).keys()
    return "step" in first and not first.isdisjoint(("coverage", "validation", "loss"))


def _is_blend(path: Path) -> bool:
    head = _head(path, 7)
    return head == b"BLENDER" or (path.suffix.lower() == ".blend" and head.startswith(_COMPRESSED))


def _members(path: Path) -> list[str]:
    with zipfile.ZipFile(path) as archive:
        return archive.namelist()


def _is_svg(path: Path) -> bool:
    return b"<svg" in _head(path, 4096) or b"<!DOCTYPE svg" in _head(path, 4096)


PNG = FileKind("a .png picture", (".png",), _begins(b"\x89PNG\r\n\x1a\n"))
EXR = FileKind("an .exr picture", (".exr",), _begins(b"\x76\x2f\x31\x01"))
SVG = FileKind("an .svg picture", (".svg",), _is_svg)
PLY = FileKind("a .ply file", (".ply",), _begins(b"ply\n", b"ply\r"))
VDB = FileKind("a .vdb file", (".vdb",), _begins(b" BDV\0\0\0\0"))
NPZ = FileKind("an .npz file", (".npz",), lambda path: all(name.endswith(".npy") for name in _members(path)))
BLEND = FileKind("a .blend file", (".blend",), _is_blend)
GLB = FileKind("a .glb file", (".glb",), _begins(b"glTF"))
SCENE_CREDITS = FileKind("credits of a scene", (".txt",), _begins(b"# Credits of a scene composed by patchnet"))
OCTREE, CODES = arrays_kind("octree"), arrays_kind("codes")
WEIGHTS, SAMPLES = arrays_kind("weights"), arrays_kind("samples")
REPORT = FileKind("a report of PatchNet", (".json",), _is_report)
FRAME_RECORD = FileKind("a frame's record of PatchNet", (".json",), _is_frame_record)
CHECKPOINT = FileKind(
    "a checkpoint of a training run", (".pt",), lambda path: any(name.endswith("/data.pkl") for name in _members(path))
)
TRAINING_LOG = FileKind("a log of a training run", (".jsonl",), _is_log)
EVALUATION = FileKind("results of an evaluation", (".json",), _begins(b'{\n "settings": {\n  "frames": '))
CYCLES_EVALUATION = FileKind(
    "results of an evaluation against Cycles", (".json",), _begins(b'{\n "settings": {\n  "cameras": ')
)
EVALUATION_TABLES = FileKind("tables of an evaluation", (".md",), _begins(b"# Tables of an evaluation"))
COSTS = FileKind("costs of an evaluation", (".json",), _begins(b'{"key": '))
ERRORS = FileKind("errors of weights", (".json",), _begins(b'{\n "errors": {'))
FIGURE_VALUES = FileKind("values of a figure of PatchNet", (".json",), _begins(b'{\n "figure": '))
