# SPDX-License-Identifier: GPL-3.0-or-later
"""Tables over all scenes: geometric means, equal budgets, equal time, Cycles."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

pd = pytest.importorskip("pandas")

from patchnet.training.evaluation.tables import (  # noqa: E402
    BUDGETS,
    cycles_tables,
    error_ratios,
    geometric_means,
    markdown_of,
)

LAB = Path(__file__).parents[2] / "docs" / "lab"


def scene(error: float, slow_ms: float) -> dict:
    """A scene of 1,000 active pixels: `slow` leaves less at each budget, and takes longer before it begins."""
    budgets = np.linspace(0, 1, 101)
    mse = {"slow": (error * (1 - budgets)).tolist(), "fast": (error * (1 - budgets) * 1.25).tolist()}
    costs = {"active_pixels": 1000, "frames": 1, "budgets": budgets.tolist(), "reference_ms_per_pixel": 0.01}
    return {"mse": mse, "ms_per_frame": {"slow": slow_ms, "fast": 0.0}} | costs


def test_geometric_means_weigh_scenes_alike() -> None:
    ratios = pd.DataFrame({"dark": [4.0, 0.0], "bright": [1.25, 1.0]}, index=["fast", "perfect"])
    assert geometric_means(ratios).tolist() == pytest.approx([(4 * 1.25) ** 0.5, 1e-9**0.5])


def test_what_is_ahead_at_equal_budgets_may_be_behind_in_equal_time() -> None:
    """Ten milliseconds are all of the own rays of a frame, and a twentieth of Cycles' samples."""
    scenes = {"one": scene(1.0, 10.0), "two": scene(1.0, 0.0)}
    for price, ahead in ((None, 2), ("own", 1), ("cycles", 2)):
        assert ((error_ratios(scenes, "slow", "fast", price) < 1).sum(axis=0) == ahead).all()
    ratios = error_ratios(scenes, "slow", "fast", "own")
    assert ratios.shape == (2, len(BUDGETS)) and ratios[1] == pytest.approx(0.8)
    assert (ratios[0] > 1).all(), "all of its time is gone before it begins"
    scenes["one"]["mse"]["slow"] = scenes["one"]["mse"]["fast"] = [0.0] * 101
    assert (error_ratios(scenes, "slow", "fast", None)[0] == 1).all(), "nobody is ahead where nothing is left"
    scenes["one"]["mse"]["slow"] = [0.1] * 101
    assert np.isinf(error_ratios(scenes, "slow", "fast", None)[0]).all()


def cells_of(text: str) -> list[list[str]]:
    """Cells of the rows of a table whose first is a name or a title and whose second is a number; without the first."""
    rows = [line.strip("| ").split(" | ") for line in text.splitlines() if re.match(r"\| [\w, -]+ \| \d", line)]
    return [row[1:] for row in rows]


def test_tables_are_those_of_the_documentation() -> None:
    scenes = json.loads((LAB / "results-cycles.json").read_text())["scenes"]
    text = markdown_of(cycles_tables(scenes))
    chapter = (LAB / "results.md").read_text().split("### Against Cycles")[1].split("###")[0]
    ours, theirs = cells_of(text), cells_of(chapter)
    assert len(ours) == len(theirs) == len(scenes) == 10
    for row, wanted in zip(ours, theirs, strict=True):
        for ours_cell, cell in zip(row, wanted, strict=True):  # results are kept with four digits: the last may differ
            unit = 10.0 ** -len(cell.partition(".")[2])
            assert float(ours_cell) == pytest.approx(float(cell), abs=1.01 * unit)
    head = next(line for line in text.splitlines() if line.startswith("| scene"))
    assert re.findall("`[^`]+`", head) == re.findall("`[^`]+`", chapter[chapter.index("| scene") :].split("\n")[0])


def test_strategies_that_are_ahead_are_counted() -> None:
    truths = {"mse": {"random": [1.0] * 101, "fine-ray": [0.5] * 101}, "bias": 0.1, "noise": 0.01}
    first, second = (truths["mse"] | {"patchnet-plus-1": [mse] * 101} for mse in (0.25, 1.0))
    scenes = {name: {"truths": {"diffuse": truths | {"mse": mse}}} for name, mse in (("a", first), ("b", second))}
    rows = markdown_of(cycles_tables(scenes)).splitlines()
    assert "| `patchnet-plus-1` | `fine-ray` |" + " 1 (2.000) |" * 6 in rows
