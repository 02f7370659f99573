# SPDX-License-Identifier: GPL-3.0-or-later
"""The script that fills tables of docs/lab/results.md with the numbers of an evaluation."""

import pytest

from patchnet.docs import make_results as script

OWN = """\
# Tables of an evaluation

Error at 30% over that of `ss-variance`.

| strategy | furnished-room | shuttle | pooled |
| --- | --- | --- | --- |
| `patchnet` | 0.47 | 0.59 | 0.85 |
| `fine-ray` | 0.28 | 0.27 | 0.45 |

Cost: rays a pixel.

| strategy | rays | median |
| --- | --- | --- |
| `patchnet` | 1 | 2.3 |
"""
PAGE = """\
Some text, and a table of something else:

| strategy | rays |
| --- | --- |
| `patchnet` | seven |

<!-- tables.md: Error at 30% -->

| strategy | pooled | room |
|---|---|---|
| `fine-ray`, no network | 1 | 2 |
| `patchnet` | 3 | 4 |

<!-- results.json: station, shuttle -->

| further rays | strategy | 10 % | 30 % by scene | excess area | ms |
|---|---|---|---|---|---|
| none | `patchnet` | 9 | 9, 9 | 9 | 9 |
| oracle | `optimal` | 9 | 9, 9 | 9 |  |
"""


def results() -> dict:
    def scene(scale: float) -> dict:
        errors = {"ss-variance": [10, 8, 4], "patchnet": [10, 4 * scale, 1 * scale], "optimal": [10, 2, 0.2]}
        excess = {name: {"value": scale * 0.0625} for name in errors}
        return {
            "budgets": [0.0, 0.1, 0.3], "mse": errors, "excess_area": excess,
            "ms_per_frame": {"patchnet": 2 * scale, "ss-variance": 1.0}, "ms_by_budget": {},
        }  # fmt: skip

    return {"scenes": {"station": scene(1.0), "shuttle": scene(4.0)}}


def test_numbers_are_those_of_the_evaluation() -> None:
    filled = script.filled(PAGE, OWN, results())
    assert "| `patchnet` | seven |" in filled and "Some text" in filled
    assert "| `fine-ray`, no network | 0.45 | 0.28 |\n| `patchnet` | 0.85 | 0.47 |" in filled
    assert "| none | `patchnet` | 1.00 | 0.25, 1.00 | 0.062 to 0.250 | 5.0 |" in filled
    assert "| oracle | `optimal` | 0.25 | 0.05, 0.05 | 0.062 to 0.250 |  |" in filled
    assert script.filled(filled, OWN, results()) == filled


@pytest.mark.parametrize(
    ("before", "after", "missing"),
    [
        ("| `patchnet` | 3 | 4 |", "| `mitchell` | 3 | 4 |", "the row of `mitchell`"),
        ("| strategy | pooled | room |", "| strategy | pooled | garden |", "the column garden"),
        ("tables.md: Error", "tables.md: Errors", "the table 'Errors at 30%'"),
        ("station, shuttle", "station, courtyard", "the scene courtyard"),
        ("| none | `patchnet` |", "| none | `mitchell` |", "the strategy mitchell"),
    ],
)
def test_what_is_not_there_is_named(before: str, after: str, missing: str) -> None:
    with pytest.raises(script.MissingError, match=missing):
        script.filled(PAGE.replace(before, after), OWN, results())


def test_marks_stand_above_tables() -> None:
    """Each comment of the page is above a table, and the tables of the evaluation have one."""
    lines = script.PAGE.read_text().splitlines()
    marked = [table for table in script.tables(lines) if script._MARK.fullmatch(script.line_above(lines, table.line))]
    assert len(marked) == 8 == sum(line.startswith("<!--") for line in lines)
