# SPDX-License-Identifier: GPL-3.0-or-later
"""Pieces that a script builds where a library has none of a kind, so that people have a room to be in.

Scenes for training have none of them: they would be in scenes for testing as well.
"""

from __future__ import annotations

from . import kinds
from .library import Piece

_SIZES = {
    kinds.TABLE: (1.7, 0.9, 0.75),
    kinds.CHAIR: (0.46, 0.5, 0.92),
    kinds.COFFEE_TABLE: (1.1, 0.6, 0.42),
    kinds.SHELF: (1.3, 0.34, 1.95),
    kinds.FLOOR_LAMP: (0.42, 0.42, 1.65),
    kinds.HANGING_LAMP: (0.5, 0.5, 0.7),
    kinds.PLANT: (0.75, 0.75, 1.35),
    kinds.SMALL: (0.26, 0.26, 0.11),
    kinds.TREE: (2.6, 2.6, 3.6),
    kinds.BUSH: (1.1, 1.1, 1.0),
    kinds.GARDEN: (1.6, 0.55, 0.85),
}


def own_piece(kind: str) -> Piece | None:
    """Piece of a kind that is built by script, whose `model` is the kind; None where there is none."""
    if kind not in _SIZES:
        return None
    top = None if kind in (kinds.FLOOR_LAMP, kinds.HANGING_LAMP, kinds.PLANT, kinds.SMALL) else _SIZES[kind][2]
    return Piece(
        f"own {kind}", "", "", kind, _SIZES[kind], top=top, creator="patchnet lab furnish", licence="GPL-3.0-or-later"
    )
