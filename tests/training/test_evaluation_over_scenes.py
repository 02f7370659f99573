# SPDX-License-Identifier: GPL-3.0-or-later
"""Strategies over all scenes: geometric means, and who is ahead at equal budgets and in equal time."""

import numpy as np
import pytest

from patchnet.training.evaluation.over_scenes import BUDGETS, error_ratios, geometric_means, scenes_ahead


def scene(error: float, slow_ms: float) -> dict:
    """A scene of 1,000 active pixels: `slow` leaves less at each budget, and takes longer before it begins."""
    budgets = np.linspace(0, 1, 101)
    mse = {"slow": (error * (1 - budgets)).tolist(), "fast": (error * (1 - budgets) * 1.25).tolist()}
    costs = {"active_pixels": 1000, "frames": 1, "budgets": budgets.tolist(), "reference_ms_per_pixel": 0.01}
    return {"mse": mse, "ms_per_frame": {"slow": slow_ms, "fast": 0.0}} | costs


def test_geometric_means_weigh_scenes_alike() -> None:
    scenes = {"dark": scene(1e-4, 1), "bright": scene(1.0, 1)}
    scenes["dark"]["mse"]["fast"] = [4 * value for value in scenes["dark"]["mse"]["slow"]]
    assert geometric_means(scenes, "fast", "slow") == pytest.approx([(4 * 1.25) ** 0.5] * len(BUDGETS))


def test_what_is_ahead_at_equal_budgets_may_be_behind_in_equal_time() -> None:
    """Ten milliseconds are all of the own rays of a frame, and a twentieth of Cycles' samples."""
    scenes = {"one": scene(1.0, 10.0), "two": scene(1.0, 0.0)}
    assert scenes_ahead(scenes, "slow", "fast", None) == [2] * len(BUDGETS)
    assert scenes_ahead(scenes, "slow", "fast", "own") == [1] * len(BUDGETS)
    assert scenes_ahead(scenes, "slow", "fast", "cycles") == [2] * len(BUDGETS)
    ratios = error_ratios(scenes, "slow", "fast", "own")
    assert ratios.shape == (2, len(BUDGETS)) and ratios[1] == pytest.approx(0.8)
    assert (ratios[0] > 1).all(), "all of its time is gone before it begins"
    scenes["one"]["mse"]["slow"] = scenes["one"]["mse"]["fast"] = [0.0] * 101
    assert (error_ratios(scenes, "slow", "fast", None)[0] == 1).all(), "nobody is ahead where nothing is left"
