# SPDX-License-Identifier: GPL-3.0-or-later
"""Fill tables of lab/results.md with the numbers of an evaluation.

    patchnet lab evaluate ... --out out/evaluation
    python docs/make_results.py out/evaluation

A table that is of an evaluation has a comment above it. `<!-- tables.md: TITLE -->` names a table of the evaluation's
own by how its title begins; `<!-- results.json: SCENE, SCENE -->` has numbers over some scenes made of its results.
Which rows and columns a page shows, in which order and by which names, is the page's to say: they stay, and only
numbers change. What sentences say of them has to be read again.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from statistics import geometric_mean, median
from typing import Any, NamedTuple

PAGE = Path(__file__).parent / "lab" / "results.md"
SCENES = {
    "San Miguel, bare": "san-miguel-bare", "San Miguel": "san-miguel", "Sponza": "sponza", "car": "sports-car",
    "room": "furnished-room", "garden": "furnished-garden",
}  # fmt: skip
KEYS = {"strategy", "rival", "at equal", "further rays", "scene"}  # columns that say what a row is of
BUDGET = 0.3
_MARK = re.compile(r"<!-- (tables\.md|results\.json): (.+) -->")
_NOTES = re.compile(r", no network$")  # that a page adds to a strategy's name


class MissingError(Exception):
    """Error of a page that shows what the evaluation does not have."""


class Table(NamedTuple):
    """Table of a page: the number of its first line, its head and its rows, of cells."""

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
    """The nearest line above that is not empty."""
    return next((line for line in reversed(lines[:number]) if line), "")


def plain(cell: str) -> str:
    """A cell of a key or a head as evaluations write it."""
    return _NOTES.sub("", SCENES.get(cell, cell)).replace(" %", "%")


def key_of(head: list[str], row: list[str]) -> tuple[str, ...]:
    """What a row is of."""
    return tuple(plain(cell) for name, cell in zip(head, row, strict=True) if name in KEYS)


def copied(table: Table, source: Table) -> list[list[str]]:
    """Rows of a table with the numbers of another, of which it shows some rows and columns."""
    names = [plain(name) for name in source.head]
    known = {key_of(source.head, row): row for row in source.rows}
    found = []
    for row in table.rows:
        numbers = known.get(key_of(table.head, row))
        if numbers is None:
            raise MissingError(f"the row of {', '.join(key_of(table.head, row))}")
        new = []
        for name, cell in zip(table.head, row, strict=True):
            if name not in KEYS and plain(name) not in names:
                raise MissingError(f"the column {name}")
            new.append(cell if name in KEYS else numbers[names.index(plain(name))])
        found.append(new)
    return found


class Results(NamedTuple):
    """Results of an evaluation over some scenes, in their order."""

    scenes: list[dict[str, Any]]

    @classmethod
    def of(cls, results: dict[str, Any], names: list[str]) -> Results:
        """Results of named scenes of `results.json`."""
        for name in names:
            if name not in results["scenes"]:
                raise MissingError(f"the scene {name}")
        return cls([results["scenes"][name] for name in names])

    def ratios(self, strategy: str, budget: float) -> list[float]:
        """Error over that of `ss-variance` by scene, at the budget that is nearest."""
        found = []
        for scene in self.scenes:
            if strategy not in scene["mse"]:
                raise MissingError(f"the strategy {strategy}")
            place = _place(scene, budget)
            found.append(scene["mse"][strategy][place] / scene["mse"]["ss-variance"][place])
        return found

    def excess(self, strategy: str) -> list[float]:
        """Excess area by scene."""
        return [scene["excess_area"][strategy]["value"] for scene in self.scenes]

    def milliseconds(self, strategy: str) -> float | None:
        """Time of a frame, median over scenes; None for what is no strategy that could be used."""
        times = [_milliseconds(scene, strategy) for scene in self.scenes]
        return median(each for each in times if each is not None) if None not in times else None


def _place(scene: dict[str, Any], budget: float) -> int:
    return min(range(len(scene["budgets"])), key=lambda place: abs(scene["budgets"][place] - budget))


def _milliseconds(scene: dict[str, Any], strategy: str) -> float | None:
    by_budget = scene["ms_by_budget"].get(strategy)
    found: float | None = by_budget[_place(scene, BUDGET)] if by_budget else scene["ms_per_frame"].get(strategy)
    return found


def rounded(value: float) -> str:
    """Two digits behind the point, three of small numbers."""
    return f"{value:.3f}" if value < 0.1 else f"{value:.2f}"


def over_scenes(table: Table, results: Results) -> list[list[str]]:
    """Rows of a table of strategies by budget, means over scenes."""
    found = []
    for row in table.rows:
        strategy = plain(next(cell for cell in row if cell.startswith("`"))).strip("`")
        found.append([_over_scenes(name, old, strategy, results) for name, old in zip(table.head, row, strict=True)])
    return found


def _over_scenes(name: str, old: str, strategy: str, results: Results) -> str:
    """Cell of such a row in the column of some name, where `old` stands."""
    if name in KEYS:
        return old
    if name.endswith("by scene"):
        return ", ".join(f"{ratio:.2f}" for ratio in results.ratios(strategy, BUDGET))
    if name == "excess area":
        values = results.excess(strategy)
        return f"{min(values):.3f} to {max(values):.3f}"
    if name == "ms":
        time = results.milliseconds(strategy)
        return "" if not old or time is None else f"{time:.1f}"
    return rounded(geometric_mean(results.ratios(strategy, float(name.removesuffix("%")) / 100)))


def filled(page: str, own: str, results: dict[str, Any]) -> str:
    """A page with the numbers of an evaluation: of its `tables.md`, and of its results. Raises MissingError."""
    lines, own_lines = page.splitlines(), own.splitlines()
    sources = {line_above(own_lines, table.line): table for table in tables(own_lines)}
    for table in tables(page.splitlines()):
        mark = _MARK.fullmatch(line_above(lines, table.line))
        if not mark:
            continue
        if mark[1] == "tables.md":
            source = next((each for title, each in sources.items() if title.startswith(mark[2])), None)
            if source is None:
                raise MissingError(f"the table '{mark[2]}'")
            rows = copied(table, source)
        else:
            rows = over_scenes(table, Results.of(results, mark[2].split(", ")))
        for number, row in enumerate(rows, table.line + 2):
            lines[number] = f"| {' | '.join(row)} |"
    return "\n".join(lines) + "\n"


def main() -> int:
    """Fill the page; returns the exit code."""
    parser = argparse.ArgumentParser(description="Fill tables of results.md.")
    parser.add_argument("evaluation", type=Path, help="folder of an evaluation, with tables.md and results.json")
    folder = parser.parse_args().evaluation
    own, results = (folder / "tables.md").read_text(), json.loads((folder / "results.json").read_text())
    try:
        PAGE.write_text(filled(PAGE.read_text(), own, results))
    except MissingError as missing:
        print(f"{PAGE.name} shows what {folder} does not have: {missing}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
