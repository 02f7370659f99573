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


def begins(*beginnings: bytes) -> Callable[[Path], bool]:
    """Test whether a file begins with one of these."""
    return lambda path: head(path, max(map(len, beginnings))).startswith(beginnings)


def head(path: Path, length: int) -> bytes:
    """First `length` bytes of a file; raises OSError."""
    with path.open("rb") as file:
        return file.read(length)


def _json(path: Path) -> Any:
    return json.loads(head(path, _MAX_TEXT_BYTES))


def _is_report(path: Path) -> bool:
    return "patchnet" in _json(path)["versions"].keys()  # noqa: SIM118  a text has none


def _is_frame_record(path: Path) -> bool:
    """Test for a frame's record; a truncated one counts, so that it does not block its frame."""
    beginning = head(path, len(_RECORD_BEGINS))
    keys = {"frame", "content", "file", "files", "summary"}
    return _RECORD_BEGINS.startswith(beginning) or keys <= _json(path).keys()


def _is_blend(path: Path) -> bool:
    beginning = head(path, 7)
    return beginning == b"BLENDER" or (path.suffix.lower() == ".blend" and beginning.startswith(_COMPRESSED))


PNG = FileKind("a .png picture", (".png",), begins(b"\x89PNG\r\n\x1a\n"))
EXR = FileKind("an .exr picture", (".exr",), begins(b"\x76\x2f\x31\x01"))
PLY = FileKind("a .ply file", (".ply",), begins(b"ply\n", b"ply\r"))
VDB = FileKind("a .vdb file", (".vdb",), begins(b" BDV\0\0\0\0"))
BLEND = FileKind("a .blend file", (".blend",), _is_blend)
OCTREE, CODES = arrays_kind("octree"), arrays_kind("codes")
REPORT = FileKind("a report of PatchNet", (".json",), _is_report)
FRAME_RECORD = FileKind("a frame's record of PatchNet", (".json",), _is_frame_record)
