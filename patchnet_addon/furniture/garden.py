# SPDX-License-Identifier: GPL-3.0-or-later
"""Gardens: trees, plants and furniture scattered on a lawn within a fence."""

from __future__ import annotations

import math

import numpy as np

from . import kinds
from .floor_plan import FloorPlan, Placement
from .groups import dining_group
from .stock import Stock

_TRIES = 150
_HEIGHT = 20.0  # metres of air
_BORDER = 0.5  # metres between the fence and what grows
_LARGEST_TREE = 8.0  # metres, of all its sides
# Kind, how many, and metres that stay free around each, in an order that leaves room for all.
_SCATTERED = (
    (kinds.TREE, 4, 0.2), (kinds.SITTING, 4, 0.2), (kinds.RESTING, 5, 0.2), (kinds.STANDING, 8, 0.2),
    (kinds.GARDEN, 6, 0.3), (kinds.TREE, 3, 0.2), (kinds.BUSH, 9, 0.15), (kinds.PLANT, 9, 0.15),
)  # fmt: skip


def plan_garden(stock: Stock, rng: np.random.Generator) -> FloorPlan:
    """Plant and furnish a garden of 12 to 17 by 10 to 14 metres; every random choice from `rng`."""
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
