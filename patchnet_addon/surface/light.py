# SPDX-License-Identifier: GPL-3.0-or-later
"""Light of a surface, as the octree's builder takes it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .mesh import ShadingFn


@dataclass(frozen=True, eq=False)
class SurfaceLight:
    """Light of a surface.

    shade: of fragments. reflects: (M,) bool, materials whose light is in proportion to their base colour.
    """

    shade: ShadingFn
    reflects: np.ndarray
