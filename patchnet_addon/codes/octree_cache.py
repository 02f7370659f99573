# SPDX-License-Identifier: GPL-3.0-or-later
"""Disk cache of finished octrees and codes, so that the next session need not voxelize, bake and encode again.

ROOT / KEY / notes.json, octree.safetensors, codes.safetensors, layout.safetensors. The key identifies the octree's
inputs. Entries are written atomically; the least recently used are removed first when the cache exceeds its limit.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import re
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..network.weights import Weights
from ..octree.file import load_octree, save_octree
from ..octree.leaf_levels import LeafLevels
from ..octree.octree import Octree
from ..runtime.cache_folder import folder_bytes
from ..runtime.errors import CodesFileError, FileFormatError, PatchNetError
from ..runtime.files import read_arrays, write_arrays
from ..runtime.owned_folder import owned_folder, remove_left_over
from .coded_octree import CodedOctree
from .file import load_codes, save_codes

KEY = re.compile(r"[0-9a-f]{32}")
NOTES, OCTREE, CODES, LAYOUT = "notes.json", "octree.safetensors", "codes.safetensors", "layout.safetensors"
_KIND = "leaf levels"
_LOG = logging.getLogger("patchnet")


@dataclass(frozen=True, eq=False)
class CachedOctree:
    """Octree, its codes and leaf levels if there are any, and notes as plain JSON values."""

    octree: Octree
    coded: CodedOctree | None = None
    layout: LeafLevels | None = None
    notes: dict[str, Any] = field(default_factory=dict)

    @property
    def nbytes(self) -> int:
        """Approximate size of its files in bytes."""
        coded = self.coded.nbytes if self.coded else 0
        return self.octree.nbytes + coded + (self.layout.levels.nbytes if self.layout else 0)


class OctreeCache:
    """Entries in a folder, of at most `max_bytes` together."""

    def __init__(self, root: Path, max_bytes: int) -> None:
        self._root, self._max_bytes = root, max_bytes

    def notes(self) -> dict[str, dict[str, Any]]:
        """Notes of all entries by key."""
        return {path.name: notes for path in self._entries() if (notes := _read_notes(path)) is not None}

    def load(self, key: str, weights: Weights | None) -> CachedOctree | None:
        """Load the entry of a key, its arrays mapped into memory, or None if it is missing or damaged.

        Codes are loaded only if `weights` made them and they are readable; else they are None.
        """
        folder = self._root / key
        notes = _read_notes(folder)
        if notes is None:
            return None
        try:
            octree = load_octree(folder / OCTREE)
            layout = None
            if (folder / LAYOUT).exists():
                layout = LeafLevels(read_arrays(folder / LAYOUT, _KIND)[0]["levels"])
        except (FileFormatError, KeyError) as error:
            _LOG.warning("A cached octree cannot be used: %s", error)
            self.remove(key)
            return None
        coded = None
        if weights is not None and (folder / CODES).exists() and notes.get("weights") == weights.hash:
            try:
                coded = load_codes(folder / CODES, octree, weights)
            except CodesFileError as error:  # codes take seconds, unlike the octree's light
                _LOG.warning("Cached codes cannot be used: %s", error)
        with contextlib.suppress(OSError):
            os.utime(folder / NOTES)  # used now
        return CachedOctree(octree, coded, layout, notes)

    def save(self, key: str, entry: CachedOctree) -> bool:
        """Store an entry, replacing the one of its key; returns whether there was room for it."""
        if entry.nbytes > self._max_bytes:
            return False
        try:
            self._root.mkdir(parents=True, exist_ok=True)
            remove_left_over(self._root, KEY.pattern)
            self._make_room(entry.nbytes, key)
            with owned_folder(self._root / key) as files:
                _write(files, entry)
                self.remove(key)
                os.replace(files, self._root / key)
        except (OSError, PatchNetError) as cause:
            _LOG.warning("The octree cannot be cached for the next session: %s", cause)
            return False
        return True

    def remove(self, key: str) -> None:
        """Delete an entry."""
        shutil.rmtree(self._root / key, ignore_errors=True)

    def _make_room(self, nbytes: int, key: str) -> None:
        """Delete entries, the least recently used first, until there is room for so many more bytes."""
        others = [path for path in self._entries() if path.name != key]
        others.sort(key=lambda path: _used(path))
        sizes = {path: folder_bytes(path) for path in others}
        total = sum(sizes.values())
        for path in others:
            if total + nbytes <= self._max_bytes:
                return
            self.remove(path.name)
            total -= sizes[path]

    def _entries(self) -> Iterator[Path]:
        with contextlib.suppress(OSError):
            yield from (path for path in sorted(self._root.iterdir()) if KEY.fullmatch(path.name) and path.is_dir())


def _write(folder: Path, entry: CachedOctree) -> None:
    save_octree(entry.octree, folder / OCTREE)
    notes = dict(entry.notes)
    if entry.coded is not None:
        save_codes(entry.coded, folder / CODES)
        notes["weights"] = entry.coded.weights.hash
    if entry.layout is not None:
        write_arrays(folder / LAYOUT, {"levels": entry.layout.levels}, {}, _KIND)
    (folder / NOTES).write_text(json.dumps(notes, indent=1), encoding="utf-8")


def _read_notes(folder: Path) -> dict[str, Any] | None:
    try:
        notes = json.loads((folder / NOTES).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return notes if isinstance(notes, dict) else None


def _used(folder: Path) -> float:
    try:
        return (folder / NOTES).stat().st_mtime
    except OSError:
        return 0.0
