# SPDX-License-Identifier: GPL-3.0-or-later
"""Advice on the present picture: look-ahead that is short, and strategies that do better, each with what to do."""

from __future__ import annotations

from dataclasses import dataclass

import bpy

from ....patchnet_addon.sampling.registry import STRATEGIES
from ...schema.table import AUTO, FIT, VIEW
from ...session.scene_result import SceneResult
from ...settings.step_settings import recorded

BETTER = 0.95  # share of the chosen strategy's error from which another one is worth a sentence


@dataclass(frozen=True)
class Advice:
    """Sentence about the picture, and the setting that a button below it changes: its name, value, and title."""

    text: str
    setting: str = ""
    value: str = ""
    button: str = ""


def advice(result: SceneResult, values: bpy.types.PropertyGroup) -> list[Advice]:
    """Advice on a result's last view; none before there is one. `values`: settings of its scene."""
    found = [_look_ahead(result, values), _strategy(result, values)]
    return [item for item in found if item is not None]


def _look_ahead(result: SceneResult, values: bpy.types.PropertyGroup) -> Advice | None:
    from ....patchnet_addon.lod.depth import LOOK_AHEAD_SHARE  # with a result its kernels are there already

    share = result.lookahead_share
    if share is None or share >= LOOK_AHEAD_SHARE:
        return None
    again = "press Preview Selection again"
    text = f"Voxels are too coarse to look ahead on {1.0 - share:.0%} of this picture: "
    if values.resolution == FIT:
        return Advice(f"{text}choose a smaller Picture Size or fewer cameras, then {again}")
    if values.resolution == AUTO:
        todo = f"{again} if camera or size changed, else fit them to the camera"
        return Advice(f"{text}{todo}", "resolution", FIT, "Fit to Cameras")
    return Advice(f"{text}let cameras choose the depth, then {again}", "resolution", AUTO, "Resolution By Cameras")


def _strategy(result: SceneResult, values: bpy.types.PropertyGroup) -> Advice | None:
    """Best strategy of the comparison where it is clearly better; only for the view that was compared."""
    if result.comparison is None or result.why(VIEW) or _others(recorded(values, VIEW)) != _others(_made_with(result)):
        return None
    rows = {row.name: row for row in result.comparison.rows if STRATEGIES[row.name].group != "oracle"}
    chosen = rows.get(values.strategy)
    best = min(rows.values(), key=lambda row: row.error, default=None)
    if chosen is None or best is None or best.error > BETTER * chosen.error:
        return None
    less = 1.0 - best.error / chosen.error
    text = f"In this picture {best.title} leaves {less:.0%} less error than {chosen.title}: choose it, and render again"
    return Advice(text, "strategy", best.name, f"Use {best.title}")


def _made_with(result: SceneResult) -> dict[str, object]:
    return result.made_with.get(VIEW, {})


def _others(settings: dict[str, object]) -> dict[str, object]:
    """Settings of a view but its strategy: a comparison holds for any."""
    return {name: value for name, value in settings.items() if name != "strategy"}
