# SPDX-License-Identifier: GPL-3.0-or-later
"""Tables of an evaluation against Cycles: those of the documentation are of the results that it keeps."""

import json
import re
from pathlib import Path

import pytest

from patchnet.training.evaluation.second_truth_tables import markdown_of_second_truth

DOCS = Path(__file__).parents[2] / "docs"


def cells_of(text: str) -> list[list[str]]:
    """Cells of the rows of a table whose first is a name or a title and whose second is a number; without the first."""
    rows = [line.strip("| ").split(" | ") for line in text.splitlines() if re.match(r"\| [\w, -]+ \| \d", line)]
    return [row[1:] for row in rows]


def test_tables_are_those_of_the_documentation() -> None:
    scenes = json.loads((DOCS / "results-cycles.json").read_text())["scenes"]
    text = markdown_of_second_truth(scenes)
    chapter = (DOCS / "results.md").read_text().split("### Against Cycles")[1].split("###")[0]
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
    rows = markdown_of_second_truth(scenes).splitlines()
    assert "| `patchnet-plus-1` | `fine-ray` |" + " 1 (2.000) |" * 6 in rows
