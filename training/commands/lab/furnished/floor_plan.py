# SPDX-License-Identifier: GPL-3.0-or-later
"""Floor plans: placement of pieces and groups of pieces as axis-aligned boxes without intersections."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from . import kinds
from .kinds import Stock
from .library import Piece

GAP = 0.02  # metres between two pieces, and between a piece and a wall
_TOUCH = 1e-6


@dataclass(frozen=True)
class Box:
    """Axis-aligned box of two corners (x, y, z) in metres."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]

    def meets(self, other: Box) -> bool:
        """Return whether both share volume; touching boxes do not."""
        return all(
            a < d - _TOUCH and c < b - _TOUCH
            for a, b, c, d in zip(self.low, self.high, other.low, other.high, strict=True)
        )

    def holds(self, other: Box) -> bool:
        """Return whether `other` is inside."""
        return all(a <= c + _TOUCH for a, c in zip(self.low, other.low, strict=True)) and all(
            d <= b + _TOUCH for b, d in zip(self.high, other.high, strict=True)
        )


@dataclass(frozen=True)
class Placement:
    """Piece at a place: the centre of its bottom (x, y, z) in metres, rotated about z by `angle` radians."""

    piece: Piece
    at: tuple[float, float, float]
    angle: float = 0.0

    def box(self, gap: float = 0.0) -> Box:
        """Bounding box, enlarged by `gap` along x and y."""
        cos, sin = abs(math.cos(self.angle)), abs(math.sin(self.angle))
        width, depth, height = self.piece.size
        x, y = (width * cos + depth * sin) / 2 + gap, (width * sin + depth * cos) / 2 + gap
        return Box((self.at[0] - x, self.at[1] - y, self.at[2]), (self.at[0] + x, self.at[1] + y, self.at[2] + height))


@dataclass
class FloorPlan:
    """Plan of a room or garden `width` (x) by `depth` (y) about the origin, `height` up from z = 0, in metres.

    kept_free: boxes without pieces, for example in front of doors.
    """

    width: float
    depth: float
    height: float
    kept_free: list[Box] = field(default_factory=list)
    placements: list[Placement] = field(default_factory=list)

    def bounds(self) -> Box:
        """Box of the whole plan."""
        return Box((-self.width / 2, -self.depth / 2, 0.0), (self.width / 2, self.depth / 2, self.height))

    def add(self, placements: Sequence[Placement], gap: float = GAP) -> bool:
        """Add all placements, if they fit within the plan without intersecting present pieces, otherwise none.

        Returns whether they were added.
        """
        taken = self.kept_free + [placement.box() for placement in self.placements]
        bounds = self.bounds()
        for placement in placements:
            wide = placement.box(gap)
            if not bounds.holds(placement.box()) or any(wide.meets(box) for box in taken):
                return False
        self.placements += placements
        return True

    def at_wall(self, piece: Piece, wall: int, along: float) -> Placement:
        """Place a piece with its back to a wall; its front is towards -y at angle 0.

        wall: 0 at +y, 1 at -x, 2 at -y, 3 at +x. along: position (-1 to 1) within the free length of the wall.
        """
        angle = wall * math.pi / 2
        inward = np.array([math.sin(angle), -math.cos(angle)]).round(12)
        tangent = np.array([-inward[1], inward[0]])
        across, length = (self.depth, self.width) if wall % 2 == 0 else (self.width, self.depth)
        middle = -inward * (across / 2 - piece.size[1] / 2 - GAP)
        middle = middle + tangent * along * max((length - piece.size[0]) / 2 - GAP, 0.0)
        return Placement(piece, (float(middle[0]), float(middle[1]), piece.elevation), angle)


def beside(placement: Placement, piece: Piece, side: int, along: float = 0.0, gap: float = GAP) -> Placement:
    """Place a piece on the floor beside another one, facing it.

    side: 0 in front of the other, 2 behind it, 1 and 3 at its ends. along: metres from the centre of that side.
    """
    angle = placement.angle + (side + 2) * math.pi / 2
    outward = np.array([math.sin(angle + math.pi), -math.cos(angle + math.pi)])
    tangent = np.array([-outward[1], outward[0]])
    reach = placement.piece.size[1 if side % 2 == 0 else 0] / 2 + piece.size[1] / 2 + gap
    at = np.array(placement.at[:2]) + outward * reach + tangent * along
    return Placement(piece, (float(at[0]), float(at[1]), 0.0), angle)


TRIES = 40  # random places per piece


def place_at_walls(plan: FloorPlan, piece: Piece | None, rng: np.random.Generator) -> Placement | None:
    """Try to place a piece at random walls."""
    for _ in range(TRIES if piece is not None else 0):
        assert piece is not None
        placement = plan.at_wall(piece, int(rng.integers(4)), float(rng.uniform(-1, 1)))
        if plan.add([placement], 0.05):
            return placement
    return None


def dining_group(
    plan: FloorPlan, stock: Stock, rng: np.random.Generator, *, has_ceiling: bool = True
) -> list[Placement]:
    """Add a table with chairs of one model on its long sides and ends and a lamp above it; returns the table."""
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
    """Add a sofa at a wall with a coffee table in front; returns the table."""
    sofa, table = stock.draw(kinds.SOFA), stock.draw(kinds.COFFEE_TABLE)
    if sofa is None:
        alone = place_at_walls(plan, table, rng)
        return [] if alone is None else [alone]
    return _wall_group(plan, sofa, table, rng, 0.4)[1:]


def desk_group(plan: FloorPlan, stock: Stock, rng: np.random.Generator) -> list[Placement]:
    """Add a desk at a wall with a chair in front; returns the desk."""
    desk, chair = stock.draw(kinds.DESK), stock.draw(kinds.CHAIR)
    return [] if desk is None else _wall_group(plan, desk, chair, rng, GAP)[:1]


def _wall_group(
    plan: FloorPlan, piece: Piece, front: Piece | None, rng: np.random.Generator, gap: float
) -> list[Placement]:
    """Add a piece at a random wall with another one in front; returns both, none without room."""
    for _ in range(TRIES):
        placed = plan.at_wall(piece, int(rng.integers(4)), float(rng.uniform(-1, 1)))
        group = [placed] if front is None else [placed, beside(placed, front, 0, gap=gap)]
        if plan.add(group):
            return group
    return []
