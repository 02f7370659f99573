# SPDX-License-Identifier: GPL-3.0-or-later
"""docs/developers.md matches the code."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "developers.md").read_text(encoding="utf-8")
PLACES = re.findall(r"`(\w+)`, \[([\w/.]+):(\d+)\]\(\.\./([\w/.]+)#L(\d+)\)", PAGE)


def test_the_paper_has_all_its_places() -> None:
    decoders, harmonics, training, evaluation = 4, 2, 3, 3
    assert len(PLACES) == 5 + decoders + harmonics + training + evaluation + 2  # and the light, and the table


@pytest.mark.parametrize("name, path, line, linked, anchor", PLACES)
def test_places_of_the_paper_are_where_the_page_says(name: str, path: str, line: str, linked: str, anchor: str) -> None:
    assert (path, line) == (linked, anchor)
    lines = (ROOT / path).read_text(encoding="utf-8").splitlines()
    found = [number for number, text in enumerate(lines, 1) if text.startswith(f"def {name}(")]
    assert found == [int(line)], f"{name} stands in line {found}: write it into docs/developers.md"


@pytest.mark.parametrize("part", ["patchnet_addon", "operators"])
def test_every_room_is_on_the_page(part: str) -> None:
    rooms = {path.parent.name for path in (ROOT / part).glob("*/__init__.py")}
    named = set(re.findall(r"`(\w+)/`", PAGE[: PAGE.index("## The flow")]))
    assert rooms <= named


def test_rooms_of_the_engine_import_those_above_them_alone() -> None:
    table = PAGE[PAGE.index("| package of `patchnet_addon/`") :].partition("\n\n")[0]
    order = re.findall(r"^\| `(\w+)/`", table, re.MULTILINE)
    for number, room in enumerate(order):
        for path in (ROOT / "patchnet_addon" / room).rglob("*.py"):
            imported = set(re.findall(r"from \.\.+(\w+)", path.read_text(encoding="utf-8"))) & set(order)
            assert imported <= set(order[: number + 1]), f"{path} imports {imported}"
