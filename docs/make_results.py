# SPDX-License-Identifier: GPL-3.0-or-later
"""Fill tables of lab/results.md with the numbers of an evaluation.

    patchnet lab evaluate ... --out out/evaluation
    python docs/make_results.py out/evaluation

Each such table has a comment above it. `<!-- tables.md: TITLE -->` names a table of the evaluation by the beginning of
its title; `<!-- results.json: SCENE, SCENE -->` has numbers over some scenes. The page determines rows, columns, their
order and names; only numbers change. Check the sentences about them afterwards.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from patchnet.training.evaluation.tables import BUDGET, over_scenes, tables_of, variance_ratios

PAGE = Path(__file__).parent / "lab" / "results.md"
SCENES = {
    "San Miguel, bare": "san-miguel-bare", "San Miguel": "san-miguel", "Sponza": "sponza", "car": "sports-car",
    "room": "furnished-room", "garden": "furnished-garden",
}  # fmt: skip
KEYS = {"strategy", "rival", "at equal", "scene"}  # columns that identify a row
OWN = KEYS | {"further rays"}  # columns without numbers of the evaluation
_MARK = re.compile(r"<!-- (tables\.md|results\.json): (.+) -->")


class MissingError(Exception):
    """A page shows a table, row or column that the evaluation lacks."""


class Table(NamedTuple):
    """Table of a page: number of its first line, cells of its head, and cells of its rows."""

    line: int
    head: list[str]
    rows: list[list[str]]


def cells(line: str) -> list[str]:
    """Cells of a line of a table."""
    return [cell.strip() for cell in line.strip().strip("|").split("|")]


def tables(lines: list[str]) -> Iterator[Table]:
    """Tables of a page."""
    number = 0
    while number < len(lines):
        end = number
        while end < len(lines) and lines[end].startswith("|"):
            end += 1
        if end - number >= 2:
            yield Table(number, cells(lines[number]), [cells(line) for line in lines[number + 2 : end]])
        number = end + 1


def line_above(lines: list[str], number: int) -> str:
    """The last line above `number` that is not empty."""
    return next((line for line in reversed(lines[:number]) if line), "")


def plain(cell: str) -> str:
    """A key or head as evaluations write it."""
    return SCENES.get(cell, cell).replace(" %", "%")


def copied(table: Table, source: pd.DataFrame) -> list[list[str]]:
    """Rows of a table with the numbers of `source`, which may have more rows and columns."""
    keys = [plain(name) for name in table.head if name in KEYS]
    known = {tuple(plain(row[name]) for name in keys): row for row in source.to_dict("records")}
    found = []
    for row in table.rows:
        key = tuple(plain(cell) for name, cell in zip(table.head, row, strict=True) if name in KEYS)
        if key not in known:
            raise MissingError(f"the row of {', '.join(key)}")
        found.append([_cell(name, cell, known[key]) for name, cell in zip(table.head, row, strict=True)])
    return found


def _cell(name: str, old: str, numbers: dict[str, str]) -> str:
    if name in OWN:
        return old
    if plain(name) not in numbers:
        raise MissingError(f"the column {name}")
    return numbers[plain(name)]


def of_scenes(results: dict[str, Any], names: list[str]) -> pd.DataFrame:
    """Strategies over named scenes: means as in an evaluation, and each scene's error ratio."""
    for name in names:
        if name not in results["scenes"]:
            raise MissingError(f"the scene {name}")
    scenes = {name: results["scenes"][name] for name in names}
    strategies = list(scenes[names[0]]["mse"])
    ratios, table = variance_ratios(scenes, BUDGET), over_scenes(scenes, strategies)
    table[f"{BUDGET}% by scene"] = [", ".join(map("{:.2f}".format, ratios.loc[name])) for name in strategies]
    return table


def filled(page: str, results: dict[str, Any]) -> str:
    """A page with the numbers of an evaluation's results. Raises MissingError."""
    lines, own = page.splitlines(), tables_of(results)
    for table in tables(page.splitlines()):
        mark = _MARK.fullmatch(line_above(lines, table.line))
        if not mark:
            continue
        if mark[1] == "results.json":
            source = of_scenes(results, mark[2].split(", "))
        elif (found := next((each for title, each in own if title.startswith(mark[2])), None)) is not None:
            source = found
        else:
            raise MissingError(f"the table '{mark[2]}'")
        for number, row in enumerate(copied(table, source), table.line + 2):
            lines[number] = f"| {' | '.join(row)} |"
    return "\n".join(lines) + "\n"


def main() -> int:
    """Fill the page; returns the exit code."""
    parser = argparse.ArgumentParser(description="Fill tables of results.md.")
    parser.add_argument("evaluation", type=Path, help="folder of an evaluation, with results.json")
    folder = parser.parse_args().evaluation
    results = json.loads((folder / "results.json").read_text())
    try:
        PAGE.write_text(filled(PAGE.read_text(), results))
    except MissingError as missing:
        print(f"{folder} lacks {missing} of {PAGE.name}: evaluate with it, or change the page", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
