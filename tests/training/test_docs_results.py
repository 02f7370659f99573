# SPDX-License-Identifier: GPL-3.0-or-later
"""The script that fills tables of docs/lab/results.md with the numbers of an evaluation."""

import json
import re
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pandas")
from patchnet.docs import make_results as script

NUMBER = re.compile(r"\d*\.\d+|\d+")
PAGE = """\
Some text, and a table of something else:

| strategy | rays |
| --- | --- |
| `patchnet` | seven |

<!-- tables.md: Error at 30% -->

| strategy | pooled | room |
|---|---|---|
| `fine-ray`, no network | 1 | 2 |

<!-- results.json: station, shuttle -->

| further rays | strategy | 10 % | 30 % by scene | excess area | ms |
|---|---|---|---|---|---|
| none | `patchnet` | 9 | 9, 9 | 9 | 9 |
| oracle | `optimal` | 9 | 9, 9 | 9 |  |
"""


@pytest.fixture(scope="module")
def results() -> dict[str, Any]:
    """Results that the page is of, rounded to four digits."""
    found: dict[str, Any] = json.loads(script.PAGE.with_name("results.json").read_text(encoding="utf-8"))
    return found


def test_numbers_of_the_page_are_those_of_the_evaluation(results: dict[str, Any]) -> None:
    """But for the last digit, and counts of scenes where two errors are the same to four digits."""
    page = script.PAGE.read_text(encoding="utf-8")
    now, then = (np.array(NUMBER.findall(text), float) for text in (page, script.filled(page, results)))
    assert np.isclose(now, then, rtol=0.01, atol=0.0101).mean() > 0.999


def test_numbers_over_some_scenes(results: dict[str, Any]) -> None:
    filled = script.filled(PAGE, results)
    assert "| `patchnet` | seven |" in filled and "Some text" in filled
    scenes = [results["scenes"][name] for name in ("station", "shuttle")]
    first, second = (np.divide(scene["mse"]["patchnet"][:31], scene["mse"]["ss-variance"][:31]) for scene in scenes)
    row = f"| none | `patchnet` | {np.sqrt(first[10] * second[10]):.2f} | {first[30]:.2f}, {second[30]:.2f} |"
    assert row in filled and re.search(r"\| oracle \| `optimal` \| [\d., |]+ \| 0\.000 to 0\.000 \|  \|", filled)
    assert script.filled(filled, results) == filled


@pytest.mark.parametrize(
    ("before", "after", "missing"),
    [
        ("| `fine-ray`, no network | 1 | 2 |", "| `none` | 3 | 4 |", "the row of `none`"),
        ("| strategy | pooled | room |", "| strategy | pooled | moon |", "the column moon"),
        ("tables.md: Error", "tables.md: Errors", "the table 'Errors at 30%'"),
        ("station, shuttle", "station, moon", "the scene moon"),
        ("| none | `patchnet` |", "| none | `none` |", "the row of `none`"),
    ],
)
def test_what_is_not_there_is_named(before: str, after: str, missing: str, results: dict[str, Any]) -> None:
    with pytest.raises(script.MissingError, match=missing):
        script.filled(PAGE.replace(before, after), results)


def test_marks_stand_above_tables() -> None:
    """Each comment of the page is above a table, and the tables of the evaluation have one."""
    lines = script.PAGE.read_text().splitlines()
    marked = [table for table in script.tables(lines) if script._MARK.fullmatch(script.line_above(lines, table.line))]
    assert len(marked) == 8 == sum(line.startswith("<!--") for line in lines)
