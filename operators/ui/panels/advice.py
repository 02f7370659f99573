# SPDX-License-Identifier: GPL-3.0-or-later
"""Advice on the present picture, with the setting to choose: look-ahead that is short, strategies that do better."""

from __future__ import annotations

import bpy

from ....patchnet_addon.sampling.registry import STRATEGIES
from ...schema.table import AUTO, FIT, VIEW
from ...session.scene_result import SceneResult
from ...settings.step_settings import recorded

BETTER = 0.95  # share of the chosen strategy's error from which another one is worth a sentence


def advice(result: SceneResult, values: bpy.types.PropertyGroup) -> list[str]:
    """Advice on a result's last view; none before there is one. `values`: settings of its scene."""
    found = [_look_ahead(result, values), _strategy(result, values)]
    return [item for item in found if item is not None]


def _look_ahead(result: SceneResult, values: bpy.types.PropertyGroup) -> str | None:
    from ....patchnet_addon.lod.depth import LOOK_AHEAD_SHARE  # with a result its kernels are there already

    share = result.lookahead_share
    if share is None or share >= LOOK_AHEAD_SHARE:
        return None
    again = "press Preview Selection again"
    text = f"Voxels are too coarse to look ahead on {1.0 - share:.0%} of this picture: "
    if values.resolution == FIT:
        return f"{text}choose a smaller Picture Size or fewer cameras, then {again}"
    if values.resolution == AUTO:
        return f"{text}{again} if camera or size changed, else choose Resolution: Fit to Cameras"
    return f"{text}choose Resolution: By Cameras, then {again}"


def _strategy(result: SceneResult, values: bpy.types.PropertyGroup) -> str | None:
    """Best strategy of the comparison where it is clearly better; only for the view that was compared."""
    if result.comparison is None or result.why(VIEW) or _others(recorded(values, VIEW)) != _others(_made_with(result)):
        return None
    rows = {row.name: row for row in result.comparison.rows if STRATEGIES[row.name].group != "oracle"}
    chosen = rows.get(values.strategy)
    best = min(rows.values(), key=lambda row: row.error, default=None)
    if chosen is None or best is None or best.error > BETTER * chosen.error:
        return None
    less = 1.0 - best.error / chosen.error
    leaves = f"leaves {less:.0%} less error than {chosen.title}"
    return f"In this picture {best.title} {leaves}: choose Strategy: {best.title}, and render again"


def _made_with(result: SceneResult) -> dict[str, object]:
    return result.made_with.get(VIEW, {})


def _others(settings: dict[str, object]) -> dict[str, object]:
    """Settings of a view but its strategy: a comparison holds for any."""
    return {name: value for name, value in settings.items() if name != "strategy"}
