# SPDX-License-Identifier: GPL-3.0-or-later
"""Kinds of furniture by name, tags, category and size, and the stock of pieces of each kind.

Where libraries lack a kind, the script builds a piece, so that scenes of people have furniture. Scenes for training
have no such pieces, because scenes for testing share them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

import numpy as np

from .library import TRAIN, Library, Piece, common_role

SOFA, BED, TABLE, COFFEE_TABLE, DESK = "sofa", "bed", "table", "coffee table", "desk"
CHAIR, ARMCHAIR, SHELF, DEVICE = "chair", "armchair", "shelf", "device"
FLOOR_LAMP, TABLE_LAMP, HANGING_LAMP = "floor lamp", "table lamp", "hanging lamp"
PLANT, SMALL, TREE, BUSH, GARDEN = "plant", "small thing", "tree", "bush", "garden furniture"
STANDING, SITTING, RESTING = "standing person", "sitting person", "person on the floor"

_Test = Callable[[set[str], Piece], bool]
_PLANTS = {"plant", "ficus", "flowers", "bonsai", "yucca", "lily", "tulips", "bamboo", "spathiphyllum"}
_SEATS = {"chair", "stool", "seat"}
_CUPBOARDS = {"bookcase", "shelves", "shelf", "wardrobe", "closet", "dresser", "cabinet", "sideboard", "chest"}
_OUTDOOR = {"outdoor", "garden", "exterior"}
_FLAT = 0.02  # metres; excludes road markings and the like


# The first matching rule counts.
_RULES: tuple[tuple[str, _Test], ...] = (
    (RESTING, lambda words, piece: "human" in words and piece.size[2] < 1.1),
    (SITTING, lambda words, piece: "human" in words and "sitting" in words),
    (STANDING, lambda words, piece: "human" in words and piece.size[2] < 2.2),
    (HANGING_LAMP, lambda words, piece: "lights" in words and bool(words & {"hanging", "pendant"})),
    (FLOOR_LAMP, lambda words, piece: _is_indoor_lamp(words, piece) and 0.9 <= piece.size[2] <= 2.1),
    (TABLE_LAMP, lambda words, piece: _is_indoor_lamp(words, piece) and piece.size[2] < 0.9),
    (TREE, lambda words, piece: _is_grown(words) and 1.6 <= piece.size[2] <= 15.0),
    (BUSH, lambda words, piece: "exterior" in words and bool(words & {"bush", "hedge", "flower"})),
    (PLANT, lambda words, piece: bool(words & _PLANTS) and 0.15 <= piece.size[2] <= 1.6),
    (SOFA, lambda words, piece: bool(words & {"sofa", "couch"}) and _is_inside(words, piece, 2.6, 1.3)),
    (BED, lambda words, piece: words >= {"bed", "bedroom"} and _is_inside(words, piece, 2.4, 1.4)),
    (ARMCHAIR, lambda words, piece: "armchair" in words and _is_inside(words, piece, 1.1, 1.2)),
    (COFFEE_TABLE, lambda words, piece: words >= {"table"} and _is_inside(words, piece, 1.6, 0.6)),
    (DESK, lambda words, piece: "desk" in words and _is_inside(words, piece, 1.8, 0.9)),
    (TABLE, lambda words, piece: "table" in words and _is_inside(words, piece, 2.2, 0.8)),
    (CHAIR, lambda words, piece: bool(words & _SEATS) and _is_inside(words, piece, 0.75, 1.1)),
    (SHELF, lambda words, piece: bool(words & _CUPBOARDS) and _is_inside(words, piece, 2.6, 2.3)),
    (GARDEN, lambda words, piece: bool(words & _OUTDOOR) and piece.size[2] > _FLAT and max(piece.size) < 3.0),
    (DEVICE, lambda words, piece: "appliance" in words and 0.5 <= piece.size[2] <= 2.0),
    (SMALL, lambda words, piece: max(piece.size) < 0.45 and min(piece.size[:2]) > 0.03),
)


def kind_of(piece: Piece) -> str | None:
    """Kind of a piece; None for unused pieces such as doors, vehicles, sockets and stairs."""
    words = set(re.findall(r"\w+", f"{piece.name} {piece.category} {piece.tags}".lower()))
    if piece.is_opening or words & {"vehicles", "staircases", "road", "bathroom"}:
        return None
    if piece.elevation > 0.05 and not words & {"lights"}:
        return None  # hangs on a wall
    return next((kind for kind, fits in _RULES if fits(words, piece)), None)


def _is_indoor_lamp(words: set[str], piece: Piece) -> bool:
    return "lights" in words and not words & _OUTDOOR and piece.elevation == 0.0 and "candle" not in words


def _is_grown(words: set[str]) -> bool:
    return bool(words & {"tree", "palm", "pine", "poplar", "cypress"}) and not words & {"bush", "hedge", "christmas"}


def _is_inside(words: set[str], piece: Piece, longest: float, highest: float) -> bool:
    """Return whether a piece is for rooms, and at most so long in plan and so high."""
    return not words & _OUTDOOR and max(piece.size[:2]) <= longest and 0.25 <= piece.size[2] <= highest


_SIZES = {
    TABLE: (1.7, 0.9, 0.75),
    CHAIR: (0.46, 0.5, 0.92),
    COFFEE_TABLE: (1.1, 0.6, 0.42),
    SHELF: (1.3, 0.34, 1.95),
    FLOOR_LAMP: (0.42, 0.42, 1.65),
    HANGING_LAMP: (0.5, 0.5, 0.7),
    PLANT: (0.75, 0.75, 1.35),
    SMALL: (0.26, 0.26, 0.11),
    TREE: (2.6, 2.6, 3.6),
    BUSH: (1.1, 1.1, 1.0),
    GARDEN: (1.6, 0.55, 0.85),
}


def own_piece(kind: str) -> Piece | None:
    """Piece of a kind that the script builds, with the kind as its `model`; None for other kinds."""
    if kind not in _SIZES:
        return None
    top = None if kind in (FLOOR_LAMP, HANGING_LAMP, PLANT, SMALL) else _SIZES[kind][2]
    return Piece(
        f"own {kind}", "", "", kind, _SIZES[kind], top=top, creator="patchnet lab furnish", licence="GPL-3.0-or-later"
    )


class Stock:
    """Stock of libraries' pieces for a scene of `role`; raises SettingError for libraries that must not be mixed."""

    def __init__(self, libraries: Sequence[Library], rng: np.random.Generator) -> None:
        self.role = common_role(library.role for library in libraries)
        self._kinds: dict[str | None, list[Piece]] = {}
        for piece in (piece for library in libraries for piece in library.pieces):
            self._kinds.setdefault(kind_of(piece), []).append(piece)
        self._rng = rng
        self._left: dict[str, list[Piece]] = {}

    def count(self, kind: str) -> int:
        """Count the libraries' pieces of a kind."""
        return len(self._kinds.get(kind, []))

    def draw(self, kind: str, fits: Callable[[Piece], bool] = lambda piece: True) -> Piece | None:
        """Draw a random fitting piece of a kind. Without one in the libraries: a built piece, or None for training."""
        if kind not in self._kinds:
            return None if self.role == TRAIN else own_piece(kind)
        left = [piece for piece in self._left.get(kind, []) if fits(piece)]
        if not left:
            left = [piece for piece in self._kinds[kind] if fits(piece)]
            if not left:
                return None
            self._left[kind] = list(self._kinds[kind])
        piece = left[int(self._rng.integers(len(left)))]
        self._left[kind].remove(piece)
        return piece
