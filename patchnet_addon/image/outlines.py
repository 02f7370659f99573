# SPDX-License-Identifier: GPL-3.0-or-later
"""Regions drawn over a picture: what is outside is dimmed, and each region has a frame."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..sampling.regions import Region, region_mask

_DIMMED = 0.35


def outlined(picture: np.ndarray, regions: Iterable[Region]) -> np.ndarray:
    """(H, W, 3) encoded colours: `picture` (H, W, 3), dimmed outside the regions, their border pixels white."""
    regions = list(regions)
    inside = region_mask(regions, *picture.shape[:2])
    result = np.where(inside[..., None], picture, picture * np.float32(_DIMMED)).astype(np.float32)
    for region in regions:
        part = result[region.slices]
        part[[0, -1]] = 1.0
        part[:, [0, -1]] = 1.0
    return result
