# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of a refinement by Cycles: its share of the picture, and its quality."""

from __future__ import annotations

from dataclasses import dataclass

from ...patchnet_addon.runtime.errors import SettingError
from ..schema.table import COMBINED, CYCLES_TABLE, DIFFUSE

WITH_GLOSS = "with-gloss"  # light that DIFFUSE renders if voxels have gloss
REFERENCE_FACTOR = 4  # samples of the reference per sample of the judged picture
REFERENCE_SEED = 1000  # that of the judged picture is 0


@dataclass(frozen=True)
class CyclesSettings:
    """Settings of a refinement by Cycles.

    budget: share of the picture's pixels. samples: paths per pixel. light: DIFFUSE is diffuse light and emission, and
    all light of metals and glass if the voxels have gloss; COMBINED is all light everywhere. compare: also render the
    whole picture, and a reference of more samples with another seed, and measure.
    """

    budget: float = CYCLES_TABLE["cycles_budget"].default
    samples: int = CYCLES_TABLE["cycles_samples"].default
    light: str = CYCLES_TABLE["cycles_light"].default
    compare: bool = CYCLES_TABLE["cycles_compare"].default

    def __post_init__(self) -> None:
        for name, value in {"cycles_budget": self.budget, "cycles_samples": self.samples}.items():
            row = CYCLES_TABLE[name]
            assert row.bounds is not None
            row.bounds.check(value)
        if self.light not in (DIFFUSE, COMBINED):
            raise SettingError(f"Cycles renders {DIFFUSE} or {COMBINED} light, not {self.light!r}: choose one of them")
