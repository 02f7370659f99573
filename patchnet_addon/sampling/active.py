# SPDX-License-Identifier: GPL-3.0-or-later
"""Active pixels, which can be wrong: those that hit something, and their neighbours (methods 7.23)."""

import numpy as np


def active_pixels(hit: np.ndarray) -> np.ndarray:
    """(H, W) bool: a pixel of `hit` (H, W) bool is active if it or any of its 8 neighbours is set."""
    padded = np.pad(hit, 1)
    rows = padded[:-2] | padded[1:-1] | padded[2:]  # (H, W + 2)
    return rows[:, :-2] | rows[:, 1:-1] | rows[:, 2:]
