# SPDX-License-Identifier: GPL-3.0-or-later
"""Size of the disk cache: compiled kernels, baked light, finished octrees, and unpacked wheels.

Only such files are counted and deleted, as the user's folder may hold others.
"""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterator
from pathlib import Path

import bpy

from ..patchnet_addon.process.computed import end_engine_process
from ..patchnet_addon.runtime.cache_folder import BAKES, KERNELS, OCTREES, WHEELS, user_cache_folder
from .jobs.job_operator import no_job_runs
from .properties.preferences import apply_preferences

_UNFINISHED = r"\.[^/]+\.[0-9a-f]{8}\.tmp/(owner|files/.+)"  # in an `owned_folder`
# Patterns of PatchNet's file names in each folder of the cache.
_FILES = {
    KERNELS: re.compile(r"[0-9a-f]{16}/([a-z]+-[0-9a-f]{16}|.+\.nb[ic])"),  # with marks of earlier versions
    BAKES: re.compile(rf"[0-9a-f]{{32}}/(round-\d{{2}}-[0-9a-f]{{16}}\.safetensors|{_UNFINISHED})"),
    OCTREES: re.compile(rf"[0-9a-f]{{32}}/(notes\.json|(octree|codes|layout)\.safetensors)|{_UNFINISHED}"),
    WHEELS: re.compile(rf"[0-9a-f]{{16}}/.+|{_UNFINISHED}"),
}


def cache_size(root: Path) -> dict[str, int]:
    """Bytes of kernels, bakes, octrees and wheels in `root`, by folder."""
    return {name: sum(map(_size, _files(root / name))) for name in _FILES}


def size_text(sizes: dict[str, int]) -> str:
    """Sizes of `cache_size` in words."""
    parts = ", ".join(f"{name} {value / 2**20:.1f}" for name, value in sizes.items() if value or name != WHEELS)
    return f"{sum(sizes.values()) / 2**20:.1f} MiB: {parts}"


def clear_cache(root: Path) -> int:
    """Delete PatchNet's files and empty folders; return the freed bytes.

    Kernels compile again at the next start, bakes in other processes are not resumed, open octrees stay open.
    """
    freed = 0
    for name in _FILES:
        for path in list(_files(root / name)):
            size = _size(path)
            with contextlib.suppress(OSError):
                path.unlink()
                freed += size
        for folder, _, _ in [] if (root / name).is_symlink() else os.walk(root / name, topdown=False):
            with contextlib.suppress(OSError):  # not empty
                os.rmdir(folder)
    return freed


def _files(folder: Path) -> Iterator[Path]:
    """PatchNet's files in a folder of the cache, without links."""
    for where, _, names in [] if folder.is_symlink() else os.walk(folder):
        for path in (Path(where, name) for name in names):
            if _FILES[folder.name].fullmatch(path.relative_to(folder).as_posix()):
                yield path


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0


class PATCHNET_OT_clear_cache(bpy.types.Operator):
    """Delete compiled kernels, baked light and finished octrees from the cache folder; later jobs make them again"""

    bl_idname = "patchnet.clear_cache"
    bl_label = "Clear Cache"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        """Require that no job runs, which may use the cache."""
        return no_job_runs(cls)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Say the sizes, and ask first."""
        apply_preferences(context)
        text = size_text(cache_size(user_cache_folder()))
        return context.window_manager.invoke_confirm(self, event, title="Clear Cache?", message=text)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Delete, and report what was freed."""
        apply_preferences(context)
        root = user_cache_folder()
        end_engine_process()  # it may import more of its wheels
        freed = clear_cache(root)
        self.report({"INFO"}, f"{freed / 2**20:.1f} MiB were freed in {root}")
        return {"FINISHED"}
