# SPDX-License-Identifier: GPL-3.0-or-later
"""Links of README, changelog and docs lead to files and headings that are there, and every page is on the site.

So do files and sections that pages and code name without a link. `make docs`, which is slow, finds dead links on the
site; what only the site lacks is looked for here, too.
"""

import re
from functools import cache
from pathlib import Path
from urllib.parse import unquote

import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", ROOT / "training/README.md", *sorted(DOCS.rglob("*.md"))]
ON_THE_SITE = 4  # levels of headings that links may name: `myst_heading_anchors` of conf.py
FENCED = re.compile(r"^( *)(`{3,}|~{3,}).*?^\1\2 *$", re.MULTILINE | re.DOTALL)
FRONT_ENDS = "## For developers"  # as docs/index.md says
CARD = ROOT / "patchnet_addon" / "network" / "weights" / "model_card.md"
SOURCES = [path for part in ("patchnet_addon", "operators", "commands", "training", "tests", "docs")
           for path in sorted((ROOT / part).rglob("*.py"))]  # fmt: skip
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
def anchors(page: Path, on_the_site: bool = False) -> frozenset[str]:
    """Names of a page's headings, with the numbers that headings of the same text get.

    on_the_site: of README those alone that the front page shows.
    """
    found: list[str] = []
    text = FENCED.sub("", page.read_text(encoding="utf-8"))
    if on_the_site and page == ROOT / "README.md":
        text = text.partition(FRONT_ENDS)[0]
    for heading in re.findall(rf"^#{{1,{ON_THE_SITE}}} +(.+?) *#*$", text, re.MULTILINE):
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
    there = anchors(file, on_the_site=page.is_relative_to(DOCS))
    return "" if anchor in there else f"{target}: {file.name} has no heading #{anchor}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    faults = [fault(page, target) for target in links(page.read_text(encoding="utf-8"))]
    assert [text for text in faults if text] == []


def test_navigation_has_every_page_and_no_other() -> None:
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    assert f'end-before: "{FRONT_ENDS}"' in index
    blocks = re.findall(r"```\{toctree\}\n(.*?)```", index, re.DOTALL)
    listed = [line for block in blocks for line in block.split("\n") if line and not line.startswith(":")]
    pages = {page.relative_to(DOCS).with_suffix("").as_posix() for page in PAGES[3:]}
    assert sorted(listed) == sorted(pages - {"index"})
    levels = re.search(r"^myst_heading_anchors = (\d)$", (DOCS / "conf.py").read_text(encoding="utf-8"), re.MULTILINE)
    assert levels and int(levels[1]) == ON_THE_SITE


@pytest.mark.parametrize("page", [page for page in (*PAGES, CARD) if page.name != "CHANGELOG.md"], ids=lambda p: p.name)
def test_files_that_pages_name_are_there(page: Path) -> None:
    """Without a link, as `tests/engine/test_links.py`; the changelog names what was there then."""
    text = page.read_text(encoding="utf-8")
    named = set(re.findall(r"`((?:patchnet_addon|operators|commands|training|tests|docs)/[\w/.-]+\.\w+)`", text))
    named |= set(re.findall(r"\bdocs/[\w/-]+\.(?:md|py|js|json|yaml|sh)\b", text))
    assert [name for name in sorted(named) if not (ROOT / name).exists()] == []


def test_pages_that_code_names_are_there() -> None:
    named = {(name, path) for path in SOURCES for name in re.findall(r"\bdocs/[\w/-]+\.md\b", path.read_text("utf-8"))}
    assert len(named) > 5
    assert [f"{path}: {name}" for name, path in sorted(named) if not (ROOT / name).exists()] == []
