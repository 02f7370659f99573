# SPDX-License-Identifier: GPL-3.0-or-later
"""docs/lab/methods.md has every section that is cited, and the code that it and docs/developers.md link is there."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
METHODS, DEVELOPERS = ROOT / "docs" / "lab" / "methods.md", ROOT / "docs" / "developers.md"
ROOMS = ("patchnet_addon", "operators", "commands", "training", "tests", "docs")
SOURCES = [path for room in ROOMS for path in sorted((ROOT / room).rglob("*"))
           if path.suffix in {".py", ".md", ".glsl", ".sh"} and path != METHODS]  # fmt: skip
SECTION = r"\d+(?:\.\d+)?[a-z]?(?![\w.]*\d)"
SECTIONS = rf"({SECTION}(?:(?:,| and| to|, and|-) ?{SECTION})*)"
CITED = re.compile(rf"\bmethods(?:\.md)?(?:\]\([^)]*\))? {SECTIONS}")
WITHIN = re.compile(rf"\b[Ss]ections? {SECTIONS}")
HEADING = re.compile(rf"^#{{2,3}} ({SECTION})\.? \S", re.MULTILINE)
CODE = re.compile(r"\[`([\w.]+)`\]\(((?:\.\./)+[\w/.]+)\)")  # a name, and the file that defines it


def test_every_cited_section_is_there() -> None:
    there = HEADING.findall(METHODS.read_text(encoding="utf-8"))
    assert len(there) == len(set(there)) > 50
    missing, count = [], 0
    for path in (METHODS, *SOURCES):
        text = re.sub(r"\s*\n\s*(?:# |// )?", " ", path.read_text(encoding="utf-8"))
        for match in (WITHIN if path == METHODS else CITED).finditer(text):
            cited = re.findall(SECTION, match[1])
            count += len(cited)
            missing += [f"{path.relative_to(ROOT)}: {match[0]}" for number in cited if number not in there]
    assert missing == []
    assert count > 200


def defines(path: Path, name: str) -> bool:
    """Return whether a module defines a function, class, method or constant."""
    *owner, last = name.split(".")
    text = path.read_text(encoding="utf-8")
    if owner:
        _, found, text = text.partition(f"\nclass {owner[0]}")
        return bool(found) and f"\n    def {last}(" in text.partition("\nclass ")[0]
    return bool(re.search(rf"^(?:(?:def|class) {last}\b|{last}\b[^=\n]*=)", text, re.MULTILINE))


@pytest.mark.parametrize(
    "page, least", [(METHODS, 110), (DEVELOPERS, 20)], ids=lambda value: getattr(value, "name", "")
)
def test_code_that_pages_link_is_defined_there(page: Path, least: int) -> None:
    found = CODE.findall(page.read_text(encoding="utf-8"))
    assert len(found) >= least
    assert [f"{name} in {file}" for name, file in found if not defines(page.parent / file, name)] == []


def test_every_section_of_the_methods_has_code() -> None:
    """All but those that define words, group others, or collect what was tried."""
    text = METHODS.read_text(encoding="utf-8")
    parts = re.split(HEADING, text)[1:]
    without = {number for number, part in zip(parts[::2], parts[1::2], strict=True) if not CODE.search(part)}
    assert without == {"1", "2", "4", "7", "11", "12", "13"}
