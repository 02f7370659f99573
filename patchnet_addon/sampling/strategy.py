# SPDX-License-Identifier: GPL-3.0-or-later
"""Strategy interface of a refinement: a name, its inputs, and a score per pixel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..runtime.errors import SettingError
from .pixel_buffers import PixelBuffers

# Inputs of a score beyond the 1-sample picture; callers compute only those of the chosen strategies.
PREDICTION = "prediction"
BEHIND = "behind"
FINE = "fine"
FINE_RAYS = "fine_rays"
EXACT = "exact"
REFERENCE = "reference"
EXACT_1 = "exact_1"
NORMAL = "normal"
CHILD_MASK = "child_mask"
CUBE_SIDE = "cube_side_world"
SCENE_LUMINANCE = "scene_luminance"

Group = Literal["network", "screen-space", "world-space", "rays", "oracle"]


@dataclass(frozen=True)
class Strategy:
    """Strategy that orders pixels for refinement.

    name: as on the command line. title: as in a menu. description: one sentence for a tooltip.
    needs: the parts of a `PixelBuffers` that must be filled in, by the names above.
    score: (P,) float32, higher is refined earlier.
    quantity: what the score measures, for legends. maximum: the score that a legend ends at by default.
    group: its inputs: the network's prediction, the centre rays' hits (screen-space), the octree below the hit voxel
    (world-space), more rays, or values too expensive for a renderer (oracle).
    extra_rays: rays per pixel beyond the one through its centre that a score costs; 0 for oracles, whose cost is not
    counted.
    """

    name: str
    title: str
    description: str
    needs: frozenset[str]
    score: Callable[[PixelBuffers], np.ndarray]
    quantity: str
    maximum: float
    group: Group = "screen-space"
    extra_rays: int = 0

    @property
    def cost(self) -> str:
        """Cost of the score in words: its rays per pixel, or the inputs of an oracle."""
        if self.group == "oracle":
            return f"oracle: needs the {'reference' if REFERENCE in self.needs else 'exact patch'}"
        return f"{1 + self.extra_rays} rays a pixel" if self.extra_rays else "1 ray a pixel"

    def scores(self, buffers: PixelBuffers) -> np.ndarray:
        """(P,) float32 scores of a view; raises SettingError as `check`."""
        self.check(buffers)
        return np.asarray(self.score(buffers), np.float32)

    def check(self, buffers: PixelBuffers) -> None:
        """Raise SettingError if a view lacks an input of this strategy."""
        missing = sorted(need for need in self.needs if getattr(buffers, need) is None)
        if missing:
            raise SettingError(f"Strategy {self.name!r} needs the view's {', '.join(missing)}: compute it first")
