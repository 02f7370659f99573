# SPDX-License-Identifier: GPL-3.0-or-later
"""Picture quality of frames at a few budgets as one array, for the strategies that decide (methods 5)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np

from ...patchnet_addon.runtime.errors import SettingError
from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
from .lpips import LpipsWeights
from .picture_metrics import LINEAR, SRGB, PictureMetrics, composed_pictures, picture_metrics

QUALITY_STRATEGIES = (
    "patchnet-plus", "patchnet-plus-1", "patchnet-plus-0", "patchnet", "patchnet-behind", "fusion", "ss-variance",
    "ss-variance-hits", "fine-ray", "fine-rays-4", "random", "optimal",
)  # fmt: skip
QUALITY_BUDGETS = (0.0, 0.1, 0.3, 0.5)
QUALITY_NAMES = tuple(
    f"{name} {encoding}" for encoding in (LINEAR, SRGB) for name in ("ssim", "ssim_active", "ms_ssim", "flip", "lpips")
)
_LEAST_SIDE = 11  # of a picture, the window of SSIM


def quality_of(
    buffers: PixelBuffers, orders: Mapping[str, np.ndarray], weights: LpipsWeights | None, *, flips: bool = True
) -> np.ndarray:
    """(Q, B, M) float64 of QUALITY_STRATEGIES, QUALITY_BUDGETS, QUALITY_NAMES; NaN for what was not measured or run.

    flips: whether FLIP is run.
    """
    quality = np.full((len(QUALITY_STRATEGIES), len(QUALITY_BUDGETS), len(QUALITY_NAMES)), np.nan)
    rows = [row for row, name in enumerate(QUALITY_STRATEGIES) if name in orders]
    if min(buffers.width, buffers.height) < _LEAST_SIDE or not rows:
        return quality
    # Without budget all strategies show the same picture.
    pictures = [composed_pictures(buffers, orders[QUALITY_STRATEGIES[rows[0]]], [0.0])]
    pictures += [composed_pictures(buffers, orders[QUALITY_STRATEGIES[row]], QUALITY_BUDGETS[1:]) for row in rows]
    found = picture_metrics(buffers, np.concatenate(pictures), weights, flips=flips)
    columns = np.concatenate([_columns(found[encoding]) for encoding in (LINEAR, SRGB)], axis=1)
    quality[rows, 0] = columns[0]
    quality[rows, 1:] = columns[1:].reshape(len(rows), -1, columns.shape[1])
    return quality


def _columns(metrics: Sequence[PictureMetrics]) -> np.ndarray:
    rows = [(item.ssim, item.ssim_active, item.ms_ssim, item.flip, item.lpips) for item in metrics]
    return np.array([[np.nan if value is None else value for value in row] for row in rows], np.float64)


@lru_cache(maxsize=1)
def lpips_weights(files: tuple[Path, Path] | None) -> LpipsWeights | None:
    """Weights of LPIPS from the files of its trunk and its heads; None without them. Raises SettingError."""
    if files is None:
        return None
    for path in files:
        if not path.is_file():
            raise SettingError(f"File {path} with weights of LPIPS does not exist: check --lpips")
    return LpipsWeights.load(*files)
