# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of a refinement by Cycles: its share of the picture, and its quality."""

from __future__ import annotations

from dataclasses import dataclass

from ...patchnet_addon.runtime import bounds
from ..schema.setting import Kind, Setting, check_values
from ..schema.values import COMBINED, DIFFUSE, REFINEMENT

WITH_GLOSS = "with-gloss"  # light that DIFFUSE renders if voxels have gloss
REFERENCE_FACTOR = 4  # samples of the reference per sample of the judged picture
REFERENCE_SEED = 1000  # that of the judged picture is 0


@dataclass(frozen=True)
class CyclesSettings:
    """Settings of a refinement by Cycles.

    light: DIFFUSE is diffuse light and emission, and all light of metals and glass if the voxels have gloss; COMBINED
    is all light everywhere. compare: the reference has another seed.
    """

    budget: float = Setting(
        "Cycles Pixels",
        "Share of the pixels that Cycles renders, by priority; more lower the error and take longer",
        REFINEMENT, Kind.SHARE, 0.2, bounds.CYCLES_BUDGET,
        name="cycles_budget",
    ).as_field()  # fmt: skip
    samples: int = Setting(
        "Cycles Samples", "Samples per pixel that Cycles renders; more reduce noise and take longer",
        REFINEMENT, Kind.NUMBER, 64, bounds.CYCLES_SAMPLES,
        name="cycles_samples",
    ).as_field()  # fmt: skip
    light: str = Setting(
        "Passes", "Light in the pixels that Cycles renders", REFINEMENT, Kind.CHOICE, DIFFUSE,
        name="cycles_light",
        choices=(
            (DIFFUSE, "Diffuse", "Diffuse light and emission, as the voxels around them do"),
            (COMBINED, "Combined", "All light, gloss and glass too; pixels with gloss then stand out"),
        ),
    ).as_field()  # fmt: skip
    compare: bool = Setting(
        "Compare to Full",
        "Also render the whole picture and a reference with four times the samples, and report time and error of both; "
        "takes far longer",
        REFINEMENT, Kind.SWITCH, False,
        name="cycles_compare",
    ).as_field()  # fmt: skip

    def __post_init__(self) -> None:
        check_values(self)
