# SPDX-License-Identifier: GPL-3.0-or-later
"""Ground of a garden, with tufts of grass and a path of slabs, and a fence of thin bars around it."""

from __future__ import annotations

import math

import bpy
import numpy as np

from ...patchnet_addon.furniture.floor_plan import FloorPlan
from ..demo_scene import textures
from ..demo_scene.geometry import Shape, box, join, place
from ..demo_scene.materials import principled

_GATE = 1.2  # metres, in the fence at -y
_PICKET, _PITCH = 0.014, 0.11


def build_yard(collection: bpy.types.Collection, plan: FloorPlan, rng: np.random.Generator) -> None:
    """Build lawn, path, grass and fence of a garden's plan."""
    x, y = plan.width / 2 + 0.4, plan.depth / 2 + 0.4
    lawn = principled("Lawn", image=textures.to_image("Lawn", textures.plaster(rng, (0.34, 0.46, 0.22), 512)))
    place(collection, "Lawn", box((-x, -y, -0.1), (x, y, 0.0)), lawn, repeat=4.0)
    place(collection, "Grass", _grass(plan, rng), principled("Grass", (0.30, 0.48, 0.18)))
    place(collection, "Path", _path(plan, rng), principled("Slabs", (0.66, 0.63, 0.58)))
    place(collection, "Fence", _fence(plan, rng), principled("Fence paint", tuple(rng.uniform(0.15, 0.85, 3))))


def _grass(plan: FloorPlan, rng: np.random.Generator, tufts: int = 900, blades: int = 7) -> Shape:
    """Triangles as blades 3 to 9 cm high, in tufts."""
    reach = np.array([plan.width / 2 + 0.3, plan.depth / 2 + 0.3])
    roots = np.repeat(rng.uniform(-1, 1, (tufts, 2)) * reach, blades, axis=0) + rng.normal(0, 0.03, (tufts * blades, 2))
    roots = np.clip(roots, -reach, reach)
    angle, count = rng.uniform(0, 2 * np.pi, len(roots)), len(roots)
    side = np.stack([np.cos(angle), np.sin(angle)], -1) * 0.004
    tip = roots + rng.normal(0, 0.025, (count, 2))
    points = np.zeros((count, 3, 3))
    points[:, 0, :2], points[:, 1, :2], points[:, 2, :2] = roots - side, roots + side, tip
    points[:, 2, 2] = rng.uniform(0.03, 0.09, count)
    number = np.arange(3 * count).reshape(count, 3)
    return Shape(points.reshape(-1, 3), [tuple(face) for face in number.tolist()])


def _path(plan: FloorPlan, rng: np.random.Generator) -> Shape:
    """Slabs of 6 mm, too low for anything to stand uneven, from the gate inwards."""
    slabs = []
    for start in np.arange(-plan.depth / 2 - 0.3, plan.depth * 0.3, 0.55):
        x = 0.12 * math.sin(2 * start) + rng.uniform(-0.04, 0.04)
        slabs.append(box((-0.4, 0.0, 0.0), (0.4, 0.48, 0.006)).moved((x, float(start), 0.0)))
    return join(slabs)


def _fence(plan: FloorPlan, rng: np.random.Generator) -> Shape:
    """Pickets of 14 mm between two rails on all four sides, posts at the corners and at the gate."""
    x, y, height = plan.width / 2 + 0.2, plan.depth / 2 + 0.2, float(rng.uniform(1.0, 1.5))
    sides = [
        (x, 0.0, [(-y, y)]),
        (y, math.pi / 2, [(-x, x)]),
        (x, math.pi, [(-y, y)]),
        (y, -math.pi / 2, [(-x, -_GATE / 2), (_GATE / 2, x)]),
    ]  # distance, direction and sections along
    parts = []
    for distance, angle, sections in sides:
        for left, right in sections:
            parts.append(_section(left, right, height).moved((distance, 0.0, 0.0)).turned(angle))
    return join(parts)


def _section(left: float, right: float, height: float) -> Shape:
    """Section of the fence along y, at x = 0."""
    half = _PICKET / 2
    count = max(round((right - left) / _PITCH), 1)
    pickets = [box((-half, y - half, 0.0), (half, y + half, height)) for y in np.linspace(left, right, count + 1)[1:-1]]
    rails = [box((-0.012, left, z), (0.012, right, z + 0.03)) for z in (0.15, height - 0.18)]
    posts = [box((-0.04, y - 0.04, 0.0), (0.04, y + 0.04, height + 0.08)) for y in (left, right)]
    return join(pickets + rails + posts)
