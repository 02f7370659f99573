# SPDX-License-Identifier: GPL-3.0-or-later
"""Properties of a refinement by Cycles."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty

from ...patchnet_addon.runtime.bounds import CYCLES_BUDGET, CYCLES_REGIONS, CYCLES_SAMPLES, CYCLES_TILE
from ..settings.cycles_settings import COMBINED, DIFFUSE, CyclesSettings
from .job import setting
from .shapes import number, share


class CyclesRefineProperties:
    """Refinement of a preview with Cycles."""

    cycles_budget: share(
        "Pixels",
        "Share of the picture's pixels that Cycles renders, in rectangles where priority is highest",
        CyclesSettings.budget,
        CYCLES_BUDGET,
    )
    cycles_samples: number(
        "Cycles Samples", "Cycles samples of each of these pixels", CyclesSettings.samples, CYCLES_SAMPLES
    )
    cycles_light: EnumProperty(
        name="Passes",
        description="What Cycles' pixels show",
        items=[
            (DIFFUSE, "Diffuse", "Diffuse light and emission, as the voxels around them do"),
            (COMBINED, "Combined", "All light, gloss and glass too; regions with gloss then stand out"),
        ],
        default=CyclesSettings.light,
    )
    cycles_tile: number(
        "Tile",
        "Side in pixels of the tiles that regions are made of: smaller ones follow the heatmap closer",
        CyclesSettings.tile,
        CYCLES_TILE,
        soft_min=4,
        subtype="PIXEL",
    )
    cycles_regions: number("Max Regions", "Regions at most", CyclesSettings.most, CYCLES_REGIONS, soft_max=32)
    cycles_compare: BoolProperty(
        name="Compare to Full",
        description="Compare with a full render: also render the whole picture with as many samples, and a reference "
        "with four times as many, and measure time and errors of both: takes far longer",
        default=CyclesSettings.compare,
    )


def cycles_settings(context: bpy.types.Context, operator: bpy.types.Operator) -> CyclesSettings:
    """Settings of a refinement by Cycles, from the operator where they are set, else from the scene."""

    def value(name: str) -> Any:
        return setting(context, operator, f"cycles_{name}")

    return CyclesSettings(
        budget=value("budget"),
        samples=value("samples"),
        tile=value("tile"),
        most=value("regions"),
        light=value("light"),
        compare=value("compare"),
    )
