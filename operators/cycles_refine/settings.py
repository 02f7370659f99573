# SPDX-License-Identifier: GPL-3.0-or-later
"""How much of a picture Cycles renders, and how well."""

from __future__ import annotations

from dataclasses import dataclass

from ...patchnet_addon.errors import SettingError
from ...patchnet_addon.sampling.regions import DEFAULT_MOST, DEFAULT_TILE

DIFFUSE, COMBINED = "diffuse", "combined"
REFERENCE_FACTOR = 4  # samples of the reference over those of what is judged


@dataclass(frozen=True)
class CyclesSettings:
    """Settings of a refinement by Cycles.

    budget: share of the picture's pixels. samples: paths per pixel. tile: side of the tiles that regions are made of,
    in pixels. most: regions at most. light: DIFFUSE is diffuse light and emission, which the voxels show too; COMBINED
    is all light, gloss and glass included. compare: also render the whole picture, and a reference of more samples with
    another seed, and measure.
    """

    budget: float = 0.2
    samples: int = 64
    tile: int = DEFAULT_TILE
    most: int = DEFAULT_MOST
    light: str = DIFFUSE
    compare: bool = False
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0.0 <= self.budget <= 1.0:
            raise SettingError(f"Cycles' budget {self.budget} is outside 0 to 1: give the share of pixels to render")
        if self.samples < 1:
            raise SettingError(f"{self.samples} Cycles samples per pixel are too few: choose at least 1")
        if self.tile < 1 or self.most < 1:
            raise SettingError(f"Tiles of {self.tile} pixels and {self.most} regions are impossible: choose at least 1")
        if self.light not in (DIFFUSE, COMBINED):
            raise SettingError(f"Cycles renders {DIFFUSE} or {COMBINED} light, not {self.light!r}: choose one of them")
