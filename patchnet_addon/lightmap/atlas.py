# SPDX-License-Identifier: GPL-3.0-or-later
"""Atlas of baked light on the charts of a surface."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .charts import Charts

COLOR_CHANNELS = 4  # of texels with colour
MIN_OPACITY = 1e-3


@dataclass(frozen=True, eq=False)
class Atlas:
    """Baked light of a surface.

    charts: where its triangles lie. texels: (pages * side * side, 2) float32, luminance weighed by opacity, and
    opacity, as the renderer saw it at the texel; with colour (.., 4), red and blue weighed by opacity too.
    noise: (pages * side * side,) float32, half of what two halves of the bake differ by, of luminance weighed by
    opacity; None where it is not known. samples: paths a texel. warnings: sentences about what was left out.
    spread: side of the square around a texel's centre that its paths go out from, in texels.
    back: the same of the triangles' backs, on the same charts; None where fronts alone were baked.
    lit: (T,) int8, sides that texels hold light of: 1 front, -1 back, 0 both; None: the front. facing: (T,) int8 alike,
    sides that are shown; one without light is black.
    back_share: (T,) float32, of the back in a triangle's one luminance; None: 0.
    base: (pages * side * side, 1) float32, luminance of the base colour that each texel was baked with; with colour
    (.., 3), red and blue, too; None where they have not been looked up yet (`texel_bases`).
    notes: entries for the octree's file, as plain JSON values.
    """

    charts: Charts
    texels: np.ndarray
    samples: int = 0
    warnings: tuple[str, ...] = ()
    noise: np.ndarray | None = None
    spread: float = 1.0
    back: Atlas | None = None
    lit: np.ndarray | None = None
    facing: np.ndarray | None = None
    back_share: np.ndarray | None = None
    base: np.ndarray | None = None
    notes: dict[str, Any] = field(default_factory=dict)
