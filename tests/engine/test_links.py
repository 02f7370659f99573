# SPDX-License-Identifier: GPL-3.0-or-later
"""Links of README, changelog and docs lead to files and headings that are there, and every page is on the site."""

import re
from functools import cache
from pathlib import Path
from urllib.parse import unquote

import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted(DOCS.glob("*.md"))]
FENCED = re.compile(r"^( *)(`{3,}|~{3,}).*?^\1\2 *$", re.MULTILINE | re.DOTALL)
CODE = re.compile(r"(`+)(?!`).+?(?<!`)\1(?!`)", re.DOTALL)
LINK = re.compile(r"(?<!\\)\[(?:[^\[\]]|\[[^\]]*\])*\]\((?P<target>[^()\s]+(?:\([^()\s]*\)[^()\s]*)*)\)")
TAG = re.compile(r"\b(?:src|href)=\"([^\"]+)\"")


def links(text: str) -> list[str]:
    """Targets of links and pictures in a page, without those to other sites and those in code."""
    prose = FENCED.sub("", text)
    tags = TAG.findall(prose)
    linked = [match["target"] for match in LINK.finditer(CODE.sub("code", prose))]
    return [target for target in linked + tags if not re.match(r"[a-z]+:", target)]


def slug(heading: str) -> str:
    """Name that GitHub and MyST give to a heading."""
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", heading.strip()).replace("`", "")
    return re.sub(r"[^\w\- ]", "", text.lower()).replace(" ", "-")


@cache
def anchors(page: Path) -> frozenset[str]:
    """Names of a page's headings, with the numbers that headings of the same text get."""
    found: list[str] = []
    for heading in re.findall(r"^#{1,6} +(.+?) *#*$", FENCED.sub("", page.read_text(encoding="utf-8")), re.MULTILINE):
        name = slug(heading)
        same = sum(bool(re.fullmatch(rf"{re.escape(name)}(-\d+)?", other)) for other in found)
        found.append(f"{name}-{same}" if same else name)
    return frozenset(found)


def fault(page: Path, target: str) -> str:
    """What is wrong with a link of a page; "" if it leads somewhere."""
    path, _, anchor = unquote(target).partition("#")
    file = (page.parent / path).resolve() if path else page
    if not file.is_relative_to(ROOT):
        return f"{target} leads out of the repository"
    if not file.exists():
        return f"{target}: there is no {path}"
    if not anchor:
        return ""
    if line := re.fullmatch(r"L(\d+)", anchor):
        lines = len(file.read_text(encoding="utf-8").splitlines())
        return "" if 0 < int(line[1]) <= lines else f"{target}: {path} has {lines} lines"
    if file.suffix != ".md":
        return f"{target}: {path} has no headings"
    return "" if anchor in anchors(file) else f"{target}: {file.name} has no heading #{anchor}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    faults = [fault(page, target) for target in links(page.read_text(encoding="utf-8"))]
    assert [text for text in faults if text] == []


def test_dead_links_are_found(tmp_path: Path) -> None:
    targets = ["tutorial.md", "tutorial.md#nowhere", "gone.md", "../setup.py#L99999", "../../other/file.md", "#gone"]
    text = "# Top\n\n" + "\n".join(f"[a `b` c]({target})" for target in targets)
    text += '\n\n`[code](gone.md)`, [site](https://example.org/x.md) and <img src="pictures/gone.png" width="3">'
    assert links(text) == [*targets, "pictures/gone.png"]
    page = DOCS / "gpu.md"
    faults = [fault(page, target) for target in links(text)]
    assert [bool(text) for text in faults] == [False, True, True, True, True, True, True]


def test_headings_have_the_names_that_github_gives() -> None:
    assert slug("Preview Selection: `patchnet.run_all`") == "preview-selection-patchnetrun_all"
    assert slug("1. The scene") == "1-the-scene"
    assert {"patchnet-for-blender", "three-clicks"} <= anchors(ROOT / "README.md")


def test_every_page_is_in_the_navigation() -> None:
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    listed = [
        name
        for block in re.findall(r"```\{toctree\}\n(.*?)```", index, re.DOTALL)
        for name in block.split()
        if not name.startswith(":") and (DOCS / f"{name}.md").exists()
    ]
    assert sorted(listed) == sorted(page.stem for page in DOCS.glob("*.md") if page.stem != "index")
