# SPDX-License-Identifier: GPL-3.0-or-later
"""Sphinx extension for links to files of the repository outside the documentation.

Pages link to code as `../patchnet_addon/octree/build.py#L24`, which GitHub shows. On the site, each such file becomes a
page with highlighted text and an anchor per line: `source/patchnet_addon/octree/build.py.html#L24`. Links to README
lead to the front page, which includes its first part.
"""

from __future__ import annotations

import html
import posixpath
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pygments import highlight
from pygments.formatters import HtmlFormatter
from pygments.lexers import guess_lexer_for_filename
from pygments.util import ClassNotFound

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
SHOWN = {".py", ".yaml", ".js", ".sh", ".toml", ".txt", ""}
LINK = re.compile(r"\[(?P<text>[^\]\n]+)\]\((?P<target>[^)\s:#]+)(?P<line>#L\d+)?\)")


def source_file(target: str, folder: Path = DOCS) -> Path | None:
    """File of the repository that a page in `folder` links to; None if it gets no page on the site."""
    path = (folder / target).resolve()
    if path.is_file() and path.is_relative_to(ROOT) and path.suffix in SHOWN:
        return path.relative_to(ROOT)
    return None


def rewritten(text: str, found: set[Path], page: str) -> str:
    """Text of a page with links to files' pages instead of files; the files are added to `found`."""
    folder = (DOCS / page).parent
    up = "../" * page.count("/")

    def link(match: re.Match[str]) -> str:
        file = source_file(match["target"], folder)
        if file is None:
            return match[0]
        found.add(file)
        shown = html.escape(match["text"].strip("`"))
        return f'<a href="{up}source/{file.as_posix()}.html{match["line"] or ""}">{shown}</a>'

    text = re.sub(r"\]\((?:\.\./)+README\.md(#[\w-]+)?\)", rf"]({up}index.md\1)", text)
    return LINK.sub(link, text.replace("](../CHANGELOG.md)", "](changelog.md)"))


def read_page(app: Any, page: str, source: list[str]) -> None:
    """Rewrite the links of a page."""
    source[0] = rewritten(source[0], app.env.repository_files, page)


def read_included(_app: Any, path: Path, _page: str, source: list[str]) -> None:
    """Rewrite links and pictures of README, which are relative to the repository's root, for the front page."""
    if path.name == "README.md":
        text = re.sub(r'(\]\(|src=")docs/', r"\1", source[0])
        source[0] = text.replace("](#for-developers)", "](command-line.md#install)")


def start(app: Any) -> None:
    """Start with no files; every build reads all pages."""
    app.env.repository_files = set()


def source_pages(app: Any) -> Iterator[tuple[str, dict[str, Any], str]]:
    """Pages of all linked files."""
    for file in sorted(app.env.repository_files):
        text = (ROOT / file).read_text(encoding="utf-8")
        formatter = HtmlFormatter(linenos="inline", linespans="L", cssclass="highlight source-file")
        try:
            lexer = guess_lexer_for_filename(file.name, text)
        except ClassNotFound:
            lexer = guess_lexer_for_filename("file.txt", text)
        # Pygments names a line L-24, GitHub and the pages' links L24.
        body = re.sub(r'id="L-(\d+)"', r'id="L\1"', highlight(text, lexer, formatter))
        title = html.escape(file.as_posix())
        context = {"title": title, "body": f"<h1>{title}</h1>\n{body}", "parents": [], "meta": {}}
        yield posixpath.join("source", file.as_posix()), context, "page.html"


def setup(app: Any) -> dict[str, bool]:
    """Register the extension's callbacks in Sphinx."""
    app.connect("builder-inited", start)
    app.connect("source-read", read_page)
    app.connect("include-read", read_included)
    app.connect("html-collect-pages", source_pages)
    return {"parallel_read_safe": False, "parallel_write_safe": True}
