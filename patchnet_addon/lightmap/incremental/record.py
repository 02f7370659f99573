# SPDX-License-Identifier: GPL-3.0-or-later
"""Record of a bake on disk: its light, and what it was baked of, for the next bake of the same scene.

ROOT / incremental-KEY / light.safetensors, beside the pages of stopped bakes: it goes with them when it is old.
"""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...runtime.cache_folder import BAKES, user_cache_folder
from ...runtime.errors import FileFormatError, PatchNetError
from ...runtime.files import read_arrays, write_arrays
from ..charts import Charts

KIND = "baked light"
CHART_ARRAYS = ("page", "x", "y", "log_width", "log_height", "kind", "origin", "along", "page_samples", "page_size")
_LOG = logging.getLogger("patchnet")


@dataclass(frozen=True, eq=False)
class BakeRecord:
    """Light of a bake and what it was baked of.

    texels: (pages * side * side, C) float32 on `charts`. drift: (T,) float32, by how much the luminance of each may
    differ from a bake of the whole scene, before exposure. turned: (T,) bool, whether it is that of the back. placed:
    of each placed mesh its hash, in the order of the surface's triangles; counts: (I,) int64, triangles of each. scene:
    what else lights it, as plain JSON values.
    """

    charts: Charts
    texels: np.ndarray
    drift: np.ndarray
    turned: np.ndarray
    placed: Sequence[str]
    counts: np.ndarray
    scene: dict[str, Any]

    def triangles_before(self, placed: Sequence[str], counts: np.ndarray) -> np.ndarray:
        """(T,) int64: which triangle each of another surface was in this one, -1 for none; arguments as the fields."""
        first = np.cumsum(self.counts) - self.counts
        known: dict[tuple[str, int], list[int]] = {}
        for key, start, count in zip(self.placed, first.tolist(), self.counts.tolist(), strict=True):
            known.setdefault((key, count), []).append(start)
        for starts in known.values():
            starts.reverse()
        before = np.full(int(counts.sum()), -1, np.int64)
        at = 0
        for key, count in zip(placed, counts.tolist(), strict=True):
            if unused := known.get((key, count)):
                before[at : at + count] = unused.pop() + np.arange(count)
            at += count
        return before


def load_record(key: str, root: Path | None = None) -> BakeRecord | None:
    """Record of a key, None where there is none that can be read."""
    path = _path(key, root)
    if not path.exists():
        return None
    try:
        arrays, metadata = read_arrays(path, KIND)
        charts = Charts(
            texel_world=metadata["texel_world"],
            growth=metadata["growth"],
            page_side=metadata["page_side"],
            **{name: arrays[name] for name in CHART_ARRAYS},
        )
        return BakeRecord(
            charts,
            arrays["texels"],
            arrays["drift"],
            arrays["turned"] > 0,
            metadata["placed"],
            arrays["counts"],
            metadata["scene"],
        )
    except (FileFormatError, KeyError) as error:
        _LOG.warning("All light is baked again: %s", error)
        with contextlib.suppress(OSError):
            path.unlink()
        return None


def save_record(key: str, record: BakeRecord, root: Path | None = None) -> None:
    """Keep a record in the place of the last one of its key; a disk that is full or read-only costs only that."""
    path, charts = _path(key, root), record.charts
    arrays = {name: getattr(charts, name) for name in CHART_ARRAYS}
    arrays |= {"texels": record.texels, "drift": record.drift, "counts": record.counts}
    arrays["turned"] = record.turned.astype(np.uint8)
    metadata = {
        "texel_world": charts.texel_world, "growth": charts.growth, "page_side": charts.page_side,
        "placed": list(record.placed), "scene": record.scene, "written": time.time(),
    }  # fmt: skip
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_arrays(path, arrays, metadata, KIND)
    except (OSError, PatchNetError) as cause:
        _LOG.warning("The next bake of this scene cannot be incremental: %s", cause)


def _path(key: str, root: Path | None) -> Path:
    return (root or user_cache_folder() / BAKES) / f"incremental-{key}" / "light.safetensors"
