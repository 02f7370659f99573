# SPDX-License-Identifier: GPL-3.0-or-later
"""Pages and sources use the terms of the field."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
MADE = {"operators.md", "commands.md"}  # from labels and helps, by scripts
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", ROOT / "training/README.md"]
PAGES += sorted(page for page in (ROOT / "docs").rglob("*.md") if page.name not in MADE)
SAY = {
    r"samples? (?:are|is) dear|dear(?:er)? samples?": "expensive",
    r"what stands still|walks? (?:of a camera|through (?:a|the) scene)": "camera fly-through of a static scene",
    r"what was in the way": "bottleneck",
    r"(?:brings?|brought) nothing|gains? nothing (?:for|to) ": "does not help",
    r"all that it could tell|(?:rays|samples) (?:all )?know\b": "capture",
    r"nobody waits|nothing else waits": "leave it out",
    r"the doors to|few doors": "the only modules that modify",
    r"whose reader is gone": "closed stdout and broken pipes",
    r"is blind\b": "predicts nothing",
    r"learned? (?:nothing )?by heart": "overfits",
    r"what a dead process left": "leftovers of killed processes",
    r"\bas ever\b": "as before",
    r"longest ago": "least recently used",
    r"[Bb]eside a window": "in a window",
    r"network (?:expects|knows|sees)\b": "predicts",
    r"to be expected of": "expected",
    r"all that is (?:seen|lit|known)\b": "the visible scene, the inputs",
    r"which a warning says|, and says so\b": "with a warning",
    r"as renders have (?:it|them)": "as in renders",
    r"a picture of yours": "your image",
    r"nobody has\b": "untested, not",
    r"\bhangs? together\b": "connected",
    r"\bown kernels\b": "built-in kernels",
}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_pages_say_the_fields_words(page: Path) -> None:
    assert other_words(page) == {}


def test_sources_say_the_fields_words() -> None:
    rooms = ("commands", "docs", "operators", "patchnet_addon", "training")
    sources = [path for room in rooms for path in (ROOT / room).rglob("*.py")]
    assert {str(path): found for path in sources if (found := other_words(path))} == {}


def other_words(path: Path) -> dict[str, str]:
    text = " ".join(path.read_text(encoding="utf-8").split())
    return {match[0]: f"say: {better}" for phrase, better in SAY.items() for match in re.finditer(phrase, text)}
