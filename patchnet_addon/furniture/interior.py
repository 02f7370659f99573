# SPDX-License-Identifier: GPL-3.0-or-later
"""Interiors: a room with a door and windows, and furniture against its walls, in groups, and on tables."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from . import kinds
from .floor_plan import Box, FloorPlan, Placement
from .groups import TRIES, desk_group, dining_group, place_at_walls, sitting_group
from .stock import Stock

# At the walls, in this order: kind, and how many at least and at most.
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


@dataclass(frozen=True)
class Room:
    """Room: its plan, and the openings in its walls."""

    plan: FloorPlan
    openings: tuple[Opening, ...]


def plan_interior(stock: Stock, rng: np.random.Generator) -> Room:
    """Furnish a room of 5 to 7.4 by 4.4 to 6.2 metres; every random choice from `rng`."""
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
    return Room(plan, openings)


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
    """Box inside the room before an opening that stays free: wide before a door, for light before a window."""
    reach = 1.0 if opening.sill == 0.0 else 0.12
    angle = opening.wall * math.pi / 2
    inward = np.array([math.sin(angle), -math.cos(angle)]).round(12)
    tangent = np.array([-inward[1], inward[0]])
    across = plan.depth if opening.wall % 2 == 0 else plan.width
    corners = [-inward * (across / 2 - d) + tangent * t for d in (0.0, reach) for t in (opening.left, opening.right)]
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    return Box((*low.tolist(), opening.sill), (*high.tolist(), opening.lintel))


def _people(plan: FloorPlan, stock: Stock, rng: np.random.Generator) -> None:
    """People where there is room, if the libraries have any."""
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
    """Up to seven small things, and a lamp perhaps, on top of a piece."""
    top = table.piece.top
    if top is None or abs(top - table.piece.size[2]) > 0.01:
        return  # nothing stands on it, or what stands higher than its top would be in the way
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
