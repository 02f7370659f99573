# SPDX-License-Identifier: GPL-3.0-or-later
"""Credits of a composed scene: names, creators and licences of all its models, for model cards and pictures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from .floor_plan import Placement
from .library import Library
from .policy import FREE, TEST, TRAIN

HEAD = "# Credits of a scene composed by patchnet lab furnish"
_USES = {
    TRAIN: "This scene may be used for training.",
    TEST: "This scene is for testing only: nothing is trained on it.",
    FREE: "Its libraries are not of the policy of docs/furnished-scenes.md: use it as their licences allow.",
}


def credits_text(
    command: str, role: str, libraries: Sequence[Library], placements: Iterable[Placement], own: str
) -> str:
    """Markdown text; own: what the script built itself, in words."""
    lines = [HEAD, "", f"    {command}", "", _USES[role], "", f"Built by the script: {own}.", ""]
    lines += [f"Library {library.name} ({library.path.name}): {_plain(library.licence)}." for library in libraries]
    lines += ["", "| model | creator | licence | file |", "|---|---|---|---|"]
    used = {placement.piece for placement in placements if placement.piece.library is not None}
    rows = sorted((piece.name, piece.creator, piece.licence, piece.model) for piece in used)
    lines += ["| " + " | ".join(map(_plain, row)) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def _plain(text: str) -> str:
    """Text in one line that does not end a cell of a table."""
    return " ".join(text.replace("|", "/").split())
