# SPDX-License-Identifier: GPL-3.0-or-later
"""Size of the disk cache: compiled kernels, pages of stopped bakes, and finished octrees.

Only files that look like those are counted and deleted. A user may have chosen a folder that holds other things.
"""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import bpy

from ..patchnet_addon.runtime.cache_folder import BAKES, KERNELS, OCTREES
from .jobs.polls import no_job_runs
from .properties.preferences import apply_preferences, kept

_HASH = re.compile(r"[0-9a-f]{16}")
_KEY = re.compile(r"[0-9a-f]{32}")
_KERNEL_FILE = re.compile(r".+\.(nbi|nbc)")
_KERNEL_MARK = re.compile(r"[a-z]+-[0-9a-f]{16}")  # see `compiled_mark`
_PAGE_FILE = re.compile(r"\.?page-\d{5}\.safetensors(\.[0-9a-f]{8}\.tmp)?")
_OCTREE_FILE = re.compile(r"notes\.json|(octree|codes|layout)\.safetensors")


@dataclass(frozen=True)
class CacheSize:
    """Bytes of compiled kernels, of pages of bakes, and of finished octrees with their codes."""

    kernels: int = 0
    bakes: int = 0
    octrees: int = 0

    @property
    def total(self) -> int:
        """Bytes of all."""
        return self.kernels + self.bakes + self.octrees

    def text(self) -> str:
        """Sizes in words."""
        parts = ", ".join(f"{name} {value / 2**20:.1f}" for name, value in asdict(self).items())
        return f"{self.total / 2**20:.1f} MiB: {parts}"


def cache_size(root: Path) -> CacheSize:
    """Size of what is ours in `root`."""
    return CacheSize(*(sum(_size(path) for path in files(root)) for files in _ALL))


def kernel_files(root: Path) -> Iterator[Path]:
    """Compiled kernels: root / kernels / 16 hex digits / a folder a module / *.nbi, *.nbc.

    Before them the marks that say that they are there: whoever deletes all and is stopped then leaves no false ones.
    """
    for version in _folders(root / KERNELS, _HASH):
        yield from (path for path in sorted(version.iterdir()) if _KERNEL_MARK.fullmatch(path.name) and path.is_file())
        for folder, _, names in os.walk(version):
            for name in names:
                if _KERNEL_FILE.fullmatch(name):
                    yield Path(folder) / name


def page_files(root: Path) -> Iterator[Path]:
    """Pages of bakes: root / bakes / 32 hex digits / page-00007.safetensors."""
    yield from _files(root / BAKES, _KEY, _PAGE_FILE)


def octree_files(root: Path) -> Iterator[Path]:
    """Finished octrees: root / octrees / 32 hex digits / octree.safetensors and what belongs to it."""
    yield from _files(root / OCTREES, _KEY, _OCTREE_FILE)


_ALL = (kernel_files, page_files, octree_files)


def clear_cache(root: Path) -> int:
    """Delete what is ours, and folders that are empty then; the bytes that were freed.

    Nothing breaks: kernels are compiled again at the next start, a bake that runs elsewhere bakes its pages again, and
    octrees that are open stay so.
    """
    freed = 0
    for path in [path for files in _ALL for path in files(root)]:
        size = _size(path)
        with contextlib.suppress(OSError):
            path.unlink()
            freed += size
    for folder in (root / KERNELS, root / BAKES, root / OCTREES):
        _remove_empty(folder)
    return freed


def _files(parent: Path, folder: re.Pattern[str], name: re.Pattern[str]) -> Iterator[Path]:
    for found in _folders(parent, folder):
        yield from (path for path in sorted(found.iterdir()) if name.fullmatch(path.name) and path.is_file())


def _folders(parent: Path, pattern: re.Pattern[str]) -> Iterator[Path]:
    if parent.is_dir() and not parent.is_symlink():
        for path in sorted(parent.iterdir()):
            if path.is_dir() and not path.is_symlink() and pattern.fullmatch(path.name):
                yield path


def _remove_empty(folder: Path) -> None:
    if not folder.is_dir() or folder.is_symlink():
        return
    for path, _, _ in os.walk(folder, topdown=False):
        with contextlib.suppress(OSError):  # not empty
            os.rmdir(path)


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0


class PATCHNET_OT_measure_cache(bpy.types.Operator):
    """Look how much compiled kernels, light of bakes and finished octrees take in the cache folder"""

    bl_idname = "patchnet.measure_cache"
    bl_label = "Measure Cache"
    bl_options = {"INTERNAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Measure, and keep the text."""
        from ..patchnet_addon.runtime.cache_folder import user_cache_folder

        apply_preferences(context)
        kept.cache = cache_size(user_cache_folder()).text()
        self.report({"INFO"}, f"Cache: {kept.cache}")
        return {"FINISHED"}


class PATCHNET_OT_clear_cache(bpy.types.Operator):
    """Delete compiled kernels, light of bakes and finished octrees from the cache folder, and nothing else.
    Kernels are compiled again when needed, bakes begin anew, and files that are opened have no
    voxels"""

    bl_idname = "patchnet.clear_cache"
    bl_label = "Clear Cache"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        """Require that no job runs, which may use the cache."""
        return no_job_runs(cls)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask first."""
        return context.window_manager.invoke_confirm(self, event)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Delete, and say what is left."""
        from ..patchnet_addon.runtime.cache_folder import user_cache_folder

        apply_preferences(context)
        root = user_cache_folder()
        freed = clear_cache(root)
        kept.cache = cache_size(root).text()
        self.report({"INFO"}, f"{freed / 2**20:.1f} MiB were freed in {root}")
        return {"FINISHED"}


CLASSES = (PATCHNET_OT_measure_cache, PATCHNET_OT_clear_cache)
