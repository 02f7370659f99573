# SPDX-License-Identifier: GPL-3.0-or-later
"""Disk cache of a bake's finished pages, so that a stopped or killed bake can be resumed.

ROOT / KEY / page-00007.safetensors: the key is a hash of all dependencies of the pages, see the baker. A finished page
is written atomically. The next bake deletes pages of abandoned bakes.
"""

from __future__ import annotations

import contextlib
import logging
import shutil
import time
from pathlib import Path
from types import TracebackType

import numpy as np

from ..runtime.cache_folder import BAKES, folder_bytes, user_cache_folder
from ..runtime.errors import FileFormatError, PatchNetError
from ..runtime.files import read_arrays, write_arrays

KIND = "light page"
MAX_AGE_S = 30 * 24 * 3600.0
MAX_BYTES = 8 << 30
_IN_USE_S = 3600.0  # a bake that wrote a page within this time may still run elsewhere
_LOG = logging.getLogger("patchnet")


class BakePageCache:
    """Context manager around a bake and its further processing.

    If the block succeeds, its pages are deleted; after an error, a stop or a kill they are kept for the next bake with
    the same key. On a full or read-only disk the bake works, but cannot be resumed.
    """

    def __init__(self, root: Path | None = None) -> None:
        """Keep pages below `root`: folder of all bakes, by default in the user's cache folder.

        found: number of pages loaded instead of baked.
        """
        self.found = 0
        self._root = root or user_cache_folder() / BAKES
        self._folders: list[Path] = []
        self._writes = True

    def __enter__(self) -> BakePageCache:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for folder in self._folders:
            if kind is None:
                shutil.rmtree(folder, ignore_errors=True)
            with contextlib.suppress(OSError):  # not empty, or missing
                folder.rmdir()

    def open(self, key: str) -> None:
        """Start the bake `key`, to which `load` and `save` belong from now on; cleans up pages of others."""
        self._folders.append(self._root / key)
        try:
            self._folders[-1].mkdir(parents=True, exist_ok=True)
        except OSError as cause:
            self._give_up(cause)
        tidy(self._root, keep=key)

    def pages(self) -> set[int]:
        """Numbers of the existing pages."""
        names = (path.stem.removeprefix("page-") for path in self._folders[-1].glob("page-*.safetensors"))
        return {int(name) for name in names if name.isdigit()}

    def load(self, page: int) -> tuple[np.ndarray, ...] | None:
        """Texels, sides with light and shares of a finished page, as saved; None if it is missing or damaged."""
        path = self._path(page)
        if not path.exists():
            return None
        try:
            arrays = read_arrays(path, KIND)[0]
        except FileFormatError as error:
            _LOG.warning("A page is baked again: %s", error)
            with contextlib.suppress(OSError):
                path.unlink()
            return None
        self.found += 1
        return arrays["texels"], arrays["lit"], arrays["back_share"]

    def save(self, page: int, texels: np.ndarray, lit: np.ndarray, back_share: np.ndarray) -> None:
        """Write a finished page: texels of both sides, float32, and the data in `Atlas` of each of its triangles."""
        if not self._writes:
            return
        try:
            self._folders[-1].mkdir(parents=True, exist_ok=True)  # another process may have finished the same bake
            arrays = {"texels": texels, "lit": lit, "back_share": back_share}
            write_arrays(self._path(page), arrays, {"page": page}, KIND)
        except (OSError, PatchNetError) as cause:
            self._give_up(cause)

    def _path(self, page: int) -> Path:
        return self._folders[-1] / f"page-{page:05d}.safetensors"

    def _give_up(self, cause: Exception) -> None:
        self._writes = False
        _LOG.warning("A bake that is stopped now cannot be resumed: %s", cause)


def tidy(root: Path, keep: str, max_age_s: float = MAX_AGE_S, max_bytes: int = MAX_BYTES) -> None:
    """Delete bakes in `root` that are too old, then the oldest while the total exceeds `max_bytes`; never `keep`.

    Other processes may write and delete there meanwhile.
    """
    now = time.time()
    bakes: list[tuple[float, Path]] = []
    with contextlib.suppress(OSError):
        for path in root.iterdir():
            with contextlib.suppress(OSError):
                bakes += [(path.stat().st_mtime, path)] if path.is_dir() else []
    bakes.sort()
    sizes = {path: folder_bytes(path) for _, path in bakes}
    total = sum(sizes.values())
    for changed, path in bakes:
        age = now - changed
        if path.name != keep and (age > max_age_s or (total > max_bytes and age > _IN_USE_S)):
            shutil.rmtree(path, ignore_errors=True)
            total -= sizes[path]
