# SPDX-License-Identifier: GPL-3.0-or-later
"""Picture's up as rays see it."""

from __future__ import annotations

import math

import numpy as np

from ..runtime.kernels import kernel
from ..runtime.threads import run_parts


def ray_up(direction: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Camera's up (3,) made orthogonal to each ray (P, 3): normalise(u - (u.w) w), (P, 3) float32 (methods 7.14)."""
    result = np.empty((len(direction), 3), np.float32)
    x, y, z = (float(axis) for axis in up)
    run_parts(_write_up, len(direction), np.ascontiguousarray(direction, np.float32), (x, y, z), result)
    return result


@kernel
def _write_up(first: int, last: int, direction: np.ndarray, up: tuple[float, float, float], result: np.ndarray) -> None:
    for ray in range(first, last):
        x, y, z = float(direction[ray, 0]), float(direction[ray, 1]), float(direction[ray, 2])
        along = x * up[0] + y * up[1] + z * up[2]
        x, y, z = up[0] - along * x, up[1] - along * y, up[2] - along * z
        scale = 1.0 / math.sqrt(x * x + y * y + z * z)
        result[ray, 0], result[ray, 1], result[ray, 2] = x * scale, y * scale, z * scale
