# SPDX-License-Identifier: GPL-3.0-or-later
"""Disk cache of baked surfels: a stopped bake goes on, a further camera bakes what it newly sees, more samples add up.

ROOT / KEY / round-02-NAME.safetensors: the key is a hash of all that the light of a surfel depends on; a file has the
surfels of one call, each with the mean of its paths in that round. It is written atomically. Old files are deleted when
a bake begins.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
import shutil
import time
from pathlib import Path

import numpy as np

from ..runtime.cache_folder import BAKES, folder_bytes, user_cache_folder
from ..runtime.errors import FileFormatError, PatchNetError
from ..runtime.files import read_arrays, write_arrays

KIND = "surfels"
MAX_AGE_S = 30 * 24 * 3600.0
MAX_BYTES = 8 << 30
_IN_USE_S = 3600.0  # a bake that wrote within this time may still run elsewhere
_LOG = logging.getLogger("patchnet")


def bakes_folder() -> Path:
    """Folder of bakes in the user's cache folder."""
    return user_cache_folder() / BAKES


class SurfelCache:
    """Baked surfels of one key. On a full or read-only disk the bake works, but its light is not kept."""

    def __init__(self, key: str, root: Path | None = None) -> None:
        """Open the surfels of `key` below `root`, by default the folder of bakes in the user's cache folder."""
        root = root or bakes_folder()
        self._folder, self._writes = root / key, True
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            self._folder.touch()
        except OSError as cause:
            self._give_up(cause)
        tidy(root, keep=key)

    def load(self, number: int, ids: np.ndarray, samples: int, channels: int) -> tuple[np.ndarray, np.ndarray]:
        """Baked light (n, channels) float32 of surfels with `ids` (n,) in a round, and (n,) bool, which are there.

        samples: paths of each in that round.
        """
        baked, there = np.zeros((len(ids), channels), np.float32), np.zeros(len(ids), bool)
        if not len(ids):
            return baked, there
        order = np.argsort(ids)
        for path in sorted(self._folder.glob(f"round-{number:02d}-*.safetensors")):
            try:
                arrays, metadata = read_arrays(path, KIND)[:2]
            except FileFormatError as error:
                _LOG.warning("Surfels are baked again: %s", error)
                with contextlib.suppress(OSError):
                    path.unlink()
                continue
            if metadata["samples"] != samples or arrays["baked"].shape[1] != channels:
                continue
            place = np.minimum(np.searchsorted(ids, arrays["ids"], sorter=order), len(ids) - 1)
            mine = order[place]
            same = ids[mine] == arrays["ids"]
            baked[mine[same]], there[mine[same]] = arrays["baked"][same], True
        return baked, there

    def save(self, number: int, ids: np.ndarray, samples: int, baked: np.ndarray) -> None:
        """Write the surfels of a call, see `load`."""
        if not self._writes:
            return
        name = hashlib.sha256(ids.tobytes() + str(samples).encode()).hexdigest()[:16]
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            arrays = {"ids": ids, "baked": baked}
            write_arrays(self._folder / f"round-{number:02d}-{name}.safetensors", arrays, {"samples": samples}, KIND)
        except (OSError, PatchNetError) as cause:
            self._give_up(cause)

    def _give_up(self, cause: Exception) -> None:
        self._writes = False
        _LOG.warning("Baked light cannot be kept: %s", cause)


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
