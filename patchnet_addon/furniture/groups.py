# SPDX-License-Identifier: GPL-3.0-or-later
"""Groups of furniture that belong together: a table with chairs, a sofa with its table, a desk with its chair."""

from __future__ import annotations

import math

import numpy as np

from . import kinds
from .floor_plan import GAP, FloorPlan, Placement, beside
from .library import Piece
from .stock import Stock

TRIES = 40  # places that are tried for a piece before it is left out


def place_at_walls(plan: FloorPlan, piece: Piece | None, rng: np.random.Generator) -> Placement | None:
    """Try to place a piece at a wall that is drawn."""
    for _ in range(TRIES if piece is not None else 0):
        assert piece is not None
        placement = plan.at_wall(piece, int(rng.integers(4)), float(rng.uniform(-1, 1)))
        if plan.add([placement], 0.05):
            return placement
    return None


def dining_group(
    plan: FloorPlan, stock: Stock, rng: np.random.Generator, *, has_ceiling: bool = True
) -> list[Placement]:
    """Table with chairs, all of one model, on its long sides and ends, and a lamp above it; returns the table."""
    table, chair = stock.draw(kinds.TABLE), stock.draw(kinds.CHAIR)
    for number in range(TRIES if table is not None else 0):
        assert table is not None
        x, y = rng.uniform(-0.6, 0.6, 2) * (plan.width / 2, plan.depth / 2)
        placed = Placement(table, (float(x), float(y), 0.0), float(rng.integers(4)) * math.pi / 2)
        chairs = _chairs(placed, chair) if number < TRIES // 2 else []
        if not plan.add([placed, *chairs], 0.1 if not chairs else GAP / 2):
            continue
        lamp = stock.draw(kinds.HANGING_LAMP, lambda piece: piece.size[2] < plan.height - 1.5)
        if has_ceiling and lamp is not None:
            plan.add([Placement(lamp, (placed.at[0], placed.at[1], plan.height - lamp.size[2]), placed.angle)])
        return [placed]
    return []


def _chairs(table: Placement, chair: Piece | None) -> list[Placement]:
    if chair is None:
        return []
    pitch = chair.size[0] + 0.12
    count = min(int(table.piece.size[0] / pitch), 3)
    offsets = [(number - (count - 1) / 2) * pitch for number in range(count)]
    chairs = [beside(table, chair, side, along) for side in (0, 2) for along in offsets]
    return chairs + [beside(table, chair, side) for side in (1, 3) if table.piece.size[1] > pitch]


def sitting_group(plan: FloorPlan, stock: Stock, rng: np.random.Generator) -> list[Placement]:
    """Sofa at a wall with a coffee table before it; returns the table."""
    sofa, table = stock.draw(kinds.SOFA), stock.draw(kinds.COFFEE_TABLE)
    if sofa is None:
        alone = place_at_walls(plan, table, rng)
        return [] if alone is None else [alone]
    for _ in range(TRIES):
        placed = plan.at_wall(sofa, int(rng.integers(4)), float(rng.uniform(-1, 1)))
        before = [] if table is None else [beside(placed, table, 0, gap=0.4)]
        if plan.add([placed, *before]):
            return before
    return []


def desk_group(plan: FloorPlan, stock: Stock, rng: np.random.Generator) -> list[Placement]:
    """Desk at a wall with a chair before it; returns the desk."""
    desk, chair = stock.draw(kinds.DESK), stock.draw(kinds.CHAIR)
    for _ in range(TRIES if desk is not None else 0):
        assert desk is not None
        placed = plan.at_wall(desk, int(rng.integers(4)), float(rng.uniform(-1, 1)))
        before = [] if chair is None else [beside(placed, chair, 0)]
        if plan.add([placed, *before]):
            return [placed]
    return []
