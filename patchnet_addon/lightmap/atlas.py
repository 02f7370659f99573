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
    notes: what was baked, for reports, as plain JSON values.
    spread: side of the square around a texel's centre that its paths go out from, in texels.
    turned: (T,) bool, triangles whose texels hold the light of their back; None where all have that of their front.
    facing: (T,) int8, side that a triangle's light is seen on: 1 front, -1 back, 0 both; None: the front.
    base: (pages * side * side, 1) float32, luminance of the base colour that each texel was baked with; with colour
    (.., 3), red and blue, too; None where they have not been looked up yet (`texel_bases`).
    """

    charts: Charts
    texels: np.ndarray
    samples: int = 0
    warnings: tuple[str, ...] = ()
    noise: np.ndarray | None = None
    notes: dict[str, Any] = field(default_factory=dict)
    spread: float = 1.0
    turned: np.ndarray | None = None
    facing: np.ndarray | None = None
    base: np.ndarray | None = None
