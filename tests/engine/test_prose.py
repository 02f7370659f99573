# SPDX-License-Identifier: GPL-3.0-or-later
"""Pages use the field's terms."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
MADE = {"operators.md", "commands.md"}  # from labels and helps, by scripts
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md"]
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
}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_pages_say_the_fields_words(page: Path) -> None:
    text = " ".join(page.read_text(encoding="utf-8").split())
    found = {match[0]: f"say: {better}" for phrase, better in SAY.items() for match in re.finditer(phrase, text)}
    assert found == {}
