# SPDX-License-Identifier: GPL-3.0-or-later
"""Roofs with tiles on the arcade and on the house."""

from __future__ import annotations

import bpy
import numpy as np

from .geometry import Shape, array, bevel, box, place, sheet, solidify
from .instancing import scatter
from .masonry import INSIDE, WALL, Materials


def build_roofs(collection: bpy.types.Collection, materials: Materials, rng: np.random.Generator) -> None:
    """Instanced clay tiles on the arcade and on the house, on boards and beams."""
    hidden = bpy.data.collections.new("Roof tile prototypes")
    prototypes = []
    for number in range(3):
        tile = place(hidden, f"Roof tile {number + 1}", _roof_tile(), materials[f"roof{number}"], smooth=True)
        solidify(tile, 0.014, rim_only=True)
        prototypes.append(tile)
    slopes = {"Arcade": ((2.32, 4.33), (5.4, 5.28)), "House": ((5.05, 7.14), (5.75, 7.42))}
    for name, (front, back) in slopes.items():
        width = INSIDE + WALL + 0.12
        boards = np.array([[(-width, *front), (width, *front)], [(-width, *back), (width, *back)]])
        place(collection, f"{name} boards", sheet(boards), materials["clay"])
        _lay_tiles(collection, name, prototypes, front, back, width, rng)
    beam = place(collection, "Beams", box((-0.06, -0.05, -0.14), (0.06, 3.1, 0)), materials["oak"], repeat=0.8)
    beam.location, beam.rotation_euler = (-5.1, 2.36, 4.28), (np.arctan2(0.95, 3.08), 0, 0)
    array(beam, 13, (0.85, 0, 0))
    bevel(beam, 0.01)


def _roof_tile() -> Shape:
    """Half round clay tile along y, tapered, 0.46 m long, lower end in the origin."""
    angles = np.linspace(0, np.pi, 13)
    rows = []
    for t in np.linspace(0, 1, 4):
        radius = 0.105 - 0.02 * t
        rows.append(np.stack([radius * np.cos(angles), 0 * angles + 0.46 * t, radius * np.sin(angles)], -1))
    return sheet(np.array(rows)[:, ::-1])


def _lay_tiles(
    collection: bpy.types.Collection,
    name: str,
    prototypes: list[bpy.types.Object],
    front: tuple[float, float],
    back: tuple[float, float],
    width: float,
    rng: np.random.Generator,
) -> None:
    """Columns of overlapping tiles up a slope from `front` to `back` (y, z)."""
    run = np.subtract(back, front)
    length, slope = float(np.hypot(*run)), float(np.arctan2(run[1], run[0]))
    rows = int(length / 0.37)
    columns = int(2 * width / 0.225)
    i, j = (axis.ravel() for axis in np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij"))
    along = (i * length / rows - 0.06) / length
    points = np.stack(
        [
            (j - (columns - 1) / 2) * 2 * width / columns,
            front[0] + along * run[0],
            front[1] + along * run[1] + 0.012 * (i > 0),
        ],
        -1,
    )
    angles = np.stack([slope + rng.normal(-0.035, 0.008, len(i)), 0 * i, rng.normal(0, 0.015, len(i))], -1)
    kind = rng.integers(0, len(prototypes), len(i))
    for number, tile in enumerate(prototypes):
        mine = kind == number
        scatter(collection, f"{name} roof {number + 1}", tile, points[mine], angles[mine])
