# SPDX-License-Identifier: GPL-3.0-or-later
"""Kinds of furniture: what a piece is in a room or a garden, by its name, tags, category and size."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable

from .library import Piece

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
_FLAT = 0.02  # metres: road markings and the like are no furniture


def _is_between(low: float, value: float, high: float) -> bool:
    return low <= value <= high


# The first that fits counts.
_RULES: tuple[tuple[str, _Test], ...] = (
    (RESTING, lambda words, piece: "human" in words and piece.size[2] < 1.1),
    (SITTING, lambda words, piece: "human" in words and "sitting" in words),
    (STANDING, lambda words, piece: "human" in words and piece.size[2] < 2.2),
    (HANGING_LAMP, lambda words, piece: "lights" in words and bool(words & {"hanging", "pendant"})),
    (FLOOR_LAMP, lambda words, piece: _is_indoor_lamp(words, piece) and _is_between(0.9, piece.size[2], 2.1)),
    (TABLE_LAMP, lambda words, piece: _is_indoor_lamp(words, piece) and piece.size[2] < 0.9),
    (TREE, lambda words, piece: _is_grown(words) and _is_between(1.6, piece.size[2], 15.0)),
    (BUSH, lambda words, piece: "exterior" in words and bool(words & {"bush", "hedge", "flower"})),
    (PLANT, lambda words, piece: bool(words & _PLANTS) and _is_between(0.15, piece.size[2], 1.6)),
    (SOFA, lambda words, piece: bool(words & {"sofa", "couch"}) and _is_inside(words, piece, 2.6, 1.3)),
    (BED, lambda words, piece: words >= {"bed", "bedroom"} and _is_inside(words, piece, 2.4, 1.4)),
    (ARMCHAIR, lambda words, piece: "armchair" in words and _is_inside(words, piece, 1.1, 1.2)),
    (COFFEE_TABLE, lambda words, piece: words >= {"table"} and _is_inside(words, piece, 1.6, 0.6)),
    (DESK, lambda words, piece: "desk" in words and _is_inside(words, piece, 1.8, 0.9)),
    (TABLE, lambda words, piece: "table" in words and _is_inside(words, piece, 2.2, 0.8)),
    (CHAIR, lambda words, piece: bool(words & _SEATS) and _is_inside(words, piece, 0.75, 1.1)),
    (SHELF, lambda words, piece: bool(words & _CUPBOARDS) and _is_inside(words, piece, 2.6, 2.3)),
    (GARDEN, lambda words, piece: bool(words & _OUTDOOR) and piece.size[2] > _FLAT and max(piece.size) < 3.0),
    (DEVICE, lambda words, piece: "appliance" in words and _is_between(0.5, piece.size[2], 2.0)),
    (SMALL, lambda words, piece: max(piece.size) < 0.45 and min(piece.size[:2]) > 0.03),
)


def kind_of(piece: Piece) -> str | None:
    """Kind of a piece, None for what no scene here has: doors, vehicles, sockets, stairs."""
    words = set(re.findall(r"\w+", f"{piece.name} {piece.category} {piece.tags}".lower()))
    if piece.is_opening or words & {"vehicles", "staircases", "road", "bathroom"}:
        return None
    if piece.elevation > 0.05 and not words & {"lights"}:
        return None  # it hangs on a wall
    return next((kind for kind, fits in _RULES if fits(words, piece)), None)


def pieces_by_kind(pieces: Iterable[Piece]) -> dict[str, list[Piece]]:
    """Pieces of each kind, in the order given."""
    found: dict[str, list[Piece]] = {}
    for piece in pieces:
        if (kind := kind_of(piece)) is not None:
            found.setdefault(kind, []).append(piece)
    return found


def _is_indoor_lamp(words: set[str], piece: Piece) -> bool:
    return "lights" in words and not words & _OUTDOOR and piece.elevation == 0.0 and "candle" not in words


def _is_grown(words: set[str]) -> bool:
    return bool(words & {"tree", "palm", "pine", "poplar", "cypress"}) and not words & {"bush", "hedge", "christmas"}


def _is_inside(words: set[str], piece: Piece, longest: float, highest: float) -> bool:
    """Tell whether it is for rooms and its floor plan and height are at most so large."""
    return not words & _OUTDOOR and max(piece.size[:2]) <= longest and 0.25 <= piece.size[2] <= highest
