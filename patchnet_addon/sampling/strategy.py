# SPDX-License-Identifier: GPL-3.0-or-later
"""Strategy interface of a refinement: a name, what it needs to know, and a score per pixel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..runtime.errors import SettingError
from .pixel_buffers import PixelBuffers

# What a score may read beyond the 1-sample picture; a caller computes only what the chosen strategies need.
PREDICTION = "prediction"
BEHIND = "behind"
FINE = "fine"
FINE_4 = "fine_4"
EXACT = "exact"
REFERENCE = "reference"


@dataclass(frozen=True)
class Strategy:
    """Strategy to decide which pixels are refined first.

    name: as on the command line. title: as in a menu. description: one sentence for a tooltip.
    needs: the parts of a `PixelBuffers` that must be filled in, of PREDICTION, BEHIND, FINE, FINE_4,
        EXACT, REFERENCE.
    score: (P,) float32, higher is refined earlier.
    quantity: what the score measures, for legends. maximum: the score that a legend ends at by default.
    """

    name: str
    title: str
    description: str
    needs: frozenset[str]
    score: Callable[[PixelBuffers], np.ndarray]
    quantity: str
    maximum: float

    def scores(self, buffers: PixelBuffers) -> np.ndarray:
        """(P,) float32 scores of a view.

        Raises SettingError if the view lacks something that this strategy reads.
        """
        missing = sorted(need for need in self.needs if getattr(buffers, need) is None)
        if missing:
            raise SettingError(f"Strategy {self.name!r} needs the view's {', '.join(missing)}: compute it first")
        return np.asarray(self.score(buffers), np.float32)
