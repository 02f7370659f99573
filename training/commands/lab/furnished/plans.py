# SPDX-License-Identifier: GPL-3.0-or-later
"""Plans of rooms and of gardens with their furniture, and the credits of a scene's models."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from . import kinds
from .floor_plan import (
    TRIES,
    Box,
    FloorPlan,
    Placement,
    desk_group,
    dining_group,
    place_at_walls,
    sitting_group,
)
from .kinds import Stock
from .library import FREE, TEST, TRAIN, Library

# Pieces at the walls, in this order: kind, least and greatest number.
_AT_WALLS = (
    (kinds.BED, 0, 1), (kinds.SHELF, 2, 4), (kinds.DEVICE, 1, 3), (kinds.FLOOR_LAMP, 1, 2), (kinds.ARMCHAIR, 1, 3),
    (kinds.PLANT, 3, 5), (kinds.CHAIR, 1, 2),
)  # fmt: skip


@dataclass(frozen=True)
class Opening:
    """Door or window in a wall: left and right end, sill and lintel, in metres; see `FloorPlan.at_wall` for walls."""

    wall: int
    left: float
    right: float
    sill: float
    lintel: float


def plan_interior(stock: Stock, rng: np.random.Generator) -> tuple[FloorPlan, tuple[Opening, ...]]:
    """Furnish a room of 5 to 7.4 by 4.4 to 6.2 metres with openings; `rng` determines every random choice."""
    plan = FloorPlan(
        float(rng.uniform(5.0, 7.4)), float(rng.uniform(4.4, 6.2)), float(rng.uniform(2.5, 2.9))
    )  # fmt: skip
    openings = _openings(plan, rng)
    plan.kept_free += [_before(plan, opening) for opening in openings]
    tables = sitting_group(plan, stock, rng) + dining_group(plan, stock, rng) + desk_group(plan, stock, rng)
    for kind, least, most in _AT_WALLS:
        for _ in range(rng.integers(least, most + 1)):
            placed = place_at_walls(plan, stock.draw(kind), rng)
            if placed is not None and kind == kinds.SHELF:
                tables.append(placed)
    _people(plan, stock, rng)
    for table in tables:
        _things_on(plan, table, stock, rng)
    return plan, openings


def _openings(plan: FloorPlan, rng: np.random.Generator) -> tuple[Opening, ...]:
    """Two windows in the wall at +y, one in that at -x or +x, and a door in that at -y."""
    half, top = plan.width / 2, 2.1
    sill, middle = float(rng.uniform(0.5, 0.9)), float(rng.uniform(-0.2, 0.2))
    side = int(rng.choice([1, 3]))
    reach = float(rng.uniform(0.25, 0.5)) * plan.depth / 2
    at = float(rng.uniform(-0.6, 0.6)) * (half - 0.6)
    return (
        Opening(0, -half + 0.5, middle - 0.2, sill, top + 0.1),
        Opening(0, middle + 0.2, half - 0.5, sill, top + 0.1),
        Opening(side, -reach, reach, sill, top),
        Opening(2, at - 0.45, at + 0.45, 0.0, top),
    )


def _before(plan: FloorPlan, opening: Opening) -> Box:
    """Box inside the room that stays free in front of an opening: deep at a door, shallow at a window."""
    reach = 1.0 if opening.sill == 0.0 else 0.12
    angle = opening.wall * math.pi / 2
    inward = np.array([math.sin(angle), -math.cos(angle)]).round(12)
    tangent = np.array([-inward[1], inward[0]])
    across = plan.depth if opening.wall % 2 == 0 else plan.width
    corners = [-inward * (across / 2 - d) + tangent * t for d in (0.0, reach) for t in (opening.left, opening.right)]
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    return Box((*low.tolist(), opening.sill), (*high.tolist(), opening.lintel))


def _people(plan: FloorPlan, stock: Stock, rng: np.random.Generator) -> None:
    """Place people in free places, if the libraries have any."""
    for kind, most in ((kinds.SITTING, 4), (kinds.RESTING, 3), (kinds.STANDING, 6)):
        for _ in range(min(most, stock.count(kind))):
            piece = stock.draw(kind)
            for _ in range(TRIES if piece is not None else 0):
                assert piece is not None
                x, y = rng.uniform(-1, 1, 2) * (plan.width / 2 - 0.3, plan.depth / 2 - 0.3)
                angle = float(rng.integers(4)) * math.pi / 2
                if plan.add([Placement(piece, (float(x), float(y), 0.0), angle)], 0.05):
                    break


def _things_on(plan: FloorPlan, table: Placement, stock: Stock, rng: np.random.Generator) -> None:
    """Place up to seven small things, and perhaps a lamp, on top of a piece."""
    top = table.piece.top
    if top is None or abs(top - table.piece.size[2]) > 0.01:
        return  # no surface on top, or parts of the piece above it
    names = [kinds.TABLE_LAMP] * int(rng.integers(2)) + [kinds.SMALL] * int(rng.integers(3, 8))
    low, high = (np.array(corner[:2]) for corner in (table.box().low, table.box().high))
    for kind in names:
        thing = stock.draw(kind)
        for _ in range(TRIES // 4 if thing is not None else 0):
            assert thing is not None
            angle = float(rng.integers(4)) * math.pi / 2
            x, y = rng.uniform(low, high)
            placed = Placement(thing, (float(x), float(y), top), angle)
            box = placed.box(0.01)
            if not Box((*low.tolist(), 0.0), (*high.tolist(), plan.height)).holds(box):
                continue
            if plan.add([placed], 0.005):
                break


_TRIES = 150
_HEIGHT = 20.0  # metres of air
_BORDER = 0.5  # metres between fence and plants
_LARGEST_TREE = 8.0  # metres, longest side
# Kind, number, and free metres around each, in an order that leaves room for all.
_SCATTERED = (
    (kinds.TREE, 4, 0.2), (kinds.SITTING, 4, 0.2), (kinds.RESTING, 5, 0.2), (kinds.STANDING, 8, 0.2),
    (kinds.GARDEN, 6, 0.3), (kinds.TREE, 3, 0.2), (kinds.BUSH, 9, 0.15), (kinds.PLANT, 9, 0.15),
)  # fmt: skip


def plan_garden(stock: Stock, rng: np.random.Generator) -> FloorPlan:
    """Plant and furnish a garden of 12 to 17 by 10 to 14 metres; `rng` determines every random choice."""
    plan = FloorPlan(float(rng.uniform(12.0, 17.0)), float(rng.uniform(10.0, 14.0)), _HEIGHT)
    reach = np.array([plan.width / 2 - _BORDER, plan.depth / 2 - _BORDER])
    dining_group(plan, stock, rng, has_ceiling=False)
    for kind, count, gap in _SCATTERED:
        people = kind in (kinds.SITTING, kinds.RESTING, kinds.STANDING)
        for _ in range(min(count, stock.count(kind)) if people else count):
            piece = stock.draw(kind, lambda piece: max(piece.size) <= _LARGEST_TREE)
            for _ in range(_TRIES if piece is not None else 0):
                assert piece is not None
                half = math.hypot(*piece.size[:2]) / 2
                x, y = rng.uniform(-1, 1, 2) * np.maximum(reach - half, 0.0)
                placed = Placement(piece, (float(x), float(y), 0.0), float(rng.uniform(0, 2 * math.pi)))
                if plan.add([placed], gap):
                    break
    return plan


HEAD = "# Credits of a scene composed by patchnet lab furnish"
_USES = {
    TRAIN: "This scene may be used for training.",
    TEST: "This scene is for testing only: do not train on it.",
    FREE: "docs/lab/furnished-scenes.md assigns its libraries no role: use this scene as their licences allow.",
}


def credits_text(
    command: str, role: str, libraries: Sequence[Library], placements: Iterable[Placement], own: str
) -> str:
    """Credits as Markdown; own: names of parts built by script."""
    lines = [HEAD, "", f"    {command}", "", _USES[role], "", f"Built by the script: {own}.", ""]
    lines += [f"Library {library.name} ({library.path.name}): {_plain(library.licence)}." for library in libraries]
    lines += ["", "| model | creator | licence | file |", "|---|---|---|---|"]
    used = {placement.piece for placement in placements if placement.piece.library is not None}
    rows = sorted((piece.name, piece.creator, piece.licence, piece.model) for piece in used)
    lines += ["| " + " | ".join(map(_plain, row)) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def _plain(text: str) -> str:
    """Text in one line without `|`, for a cell of a table."""
    return " ".join(text.replace("|", "/").split())
