# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of a refinement by Cycles: its share of the picture, and its quality."""

from __future__ import annotations

from dataclasses import dataclass

from ...patchnet_addon.runtime import bounds
from ...patchnet_addon.runtime.errors import SettingError
from ...patchnet_addon.sampling.regions import DEFAULT_MOST, DEFAULT_TILE

DIFFUSE, COMBINED = "diffuse", "combined"
WITH_GLOSS = "with-gloss"  # what DIFFUSE renders beside voxels with gloss
REFERENCE_FACTOR = 4  # samples of the reference over those of what is judged


@dataclass(frozen=True)
class CyclesSettings:
    """Settings of a refinement by Cycles.

    budget: share of the picture's pixels. samples: paths per pixel. tile: side of the tiles that regions are made of,
    in pixels. most: regions at most. light: DIFFUSE is diffuse light and emission, and all light of metals and glass if
    the voxels have gloss; COMBINED is all light everywhere. compare: also render the whole picture, and a reference of
    more samples with another seed, and measure.
    """

    budget: float = 0.2
    samples: int = 64
    tile: int = DEFAULT_TILE
    most: int = DEFAULT_MOST
    light: str = DIFFUSE
    compare: bool = False
    seed: int = 0

    def __post_init__(self) -> None:
        bounds.CYCLES_BUDGET.check(self.budget)
        bounds.CYCLES_SAMPLES.check(self.samples)
        bounds.CYCLES_TILE.check(self.tile)
        bounds.CYCLES_REGIONS.check(self.most)
        if self.light not in (DIFFUSE, COMBINED):
            raise SettingError(f"Cycles renders {DIFFUSE} or {COMBINED} light, not {self.light!r}: choose one of them")
