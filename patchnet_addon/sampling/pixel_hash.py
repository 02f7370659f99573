# SPDX-License-Identifier: GPL-3.0-or-later
"""Hash of the pixel's index: breaks ties and stands for chance, the same in every run (methods 3)."""

import numpy as np


def pixel_hash(count: int) -> np.ndarray:
    """(count,) uint64: the finaliser of SplitMix64 applied to the pixels' indices; a permutation, so without ties."""
    value = np.arange(1, count + 1, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    value = (value ^ (value >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    value = (value ^ (value >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return value ^ (value >> np.uint64(31))
