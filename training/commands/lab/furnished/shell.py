# SPDX-License-Identifier: GPL-3.0-or-later
"""Shells: a room's floor, ceiling, walls with openings, bars, blinds and skirting; a garden's lawn, path and fence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import bpy
import numpy as np

from .....operators.computing import demo_textures as textures
from .....operators.demo_scene.geometry import Shape, box, join, place
from .....operators.demo_scene.materials import principled, to_image
from .floor_plan import FloorPlan
from .plans import Opening

_WALL = 0.16  # metres
_BAR, _SLAT = 0.028, 0.002
_PALETTE = ((0.90, 0.87, 0.80), (0.76, 0.83, 0.84), (0.86, 0.76, 0.66), (0.80, 0.85, 0.74), (0.92, 0.91, 0.89))


def build_shell(
    collection: bpy.types.Collection, plan: FloorPlan, openings: Sequence[Opening], rng: np.random.Generator
) -> None:
    """Build floor, ceiling and four walls around a room's plan, closed except for its openings."""
    x, y = plan.width / 2 + _WALL, plan.depth / 2 + _WALL
    planks = principled("Planks", image=to_image("Planks", _planks(rng)), roughness=0.7)
    white = principled("White paint", (0.93, 0.92, 0.90))
    place(collection, "Floor", box((-x, -y, -_WALL), (x, y, 0.0)), planks, repeat=2.0)
    place(collection, "Ceiling", box((-x, -y, plan.height), (x, y, plan.height + _WALL)), white)
    colours = rng.permutation(len(_PALETTE))
    for wall in range(4):
        own = [opening for opening in openings if opening.wall == wall]
        paint = principled(f"Wall {wall + 1}", _PALETTE[colours[0 if wall % 2 else 1]])
        place(collection, f"Wall {wall + 1}", _set(plan, wall, _wall(plan, wall, own)), paint)
        trims = [*map(_trim, own), _skirting(plan, wall, own)]
        place(collection, f"Frames {wall + 1}", _set(plan, wall, join(trims)), white)
        for number, opening in enumerate(opening for opening in own if opening.sill > 0 and wall):
            place(collection, f"Blind {wall + 1}.{number}", _set(plan, wall, _blind(opening)), white)


def _lengths(plan: FloorPlan, wall: int) -> tuple[float, float]:
    """Length of a wall, and its distance from the centre of the room."""
    return (plan.width, plan.depth / 2) if wall % 2 == 0 else (plan.depth, plan.width / 2)


def _set(plan: FloorPlan, wall: int, shape: Shape) -> Shape:
    """Move a shape to its wall; its x is along the wall, its y outwards from the inner face."""
    return shape.moved((0.0, _lengths(plan, wall)[1], 0.0)).turned(wall * math.pi / 2)


def _wall(plan: FloorPlan, wall: int, openings: list[Opening]) -> Shape:
    """Wall around its openings, in cells without faces between them; walls at +y and -y reach over the corners."""
    half = _lengths(plan, wall)[0] / 2 + (_WALL if wall % 2 == 0 else 0.0)
    x = sorted({-half, half, *(end for opening in openings for end in (opening.left, opening.right))})
    z = sorted({0.0, plan.height, *(end for opening in openings for end in (opening.sill, opening.lintel))})
    solid = np.zeros((len(x) + 1, len(z) + 1), bool)  # with a border of empty cells
    solid[1:-1, 1:-1] = [
        [not _is_open(openings, (a + b) / 2, (c + d) / 2) for c, d in pairwise(z)] for a, b in pairwise(x)
    ]
    cells = []
    for i, k in np.argwhere(solid).tolist():
        cell = box((x[i - 1], 0.0, z[k - 1]), (x[i], _WALL, z[k]))
        # A box's faces +x and -x are its third and second, +z and -z its first and last.
        hidden = {2: solid[i + 1, k], 1: solid[i - 1, k], 0: solid[i, k + 1], 5: solid[i, k - 1]}
        cells.append(Shape(cell.vertices, [face for number, face in enumerate(cell.faces) if not hidden.get(number)]))
    return join(cells)


def _is_open(openings: list[Opening], x: float, z: float) -> bool:
    return any(one.left < x < one.right and one.sill < z < one.lintel for one in openings)


def _trim(opening: Opening) -> Shape:
    """Frame of an opening within the wall; windows have bars in a grid, too."""
    a, b, c, d = opening.left, opening.right, opening.sill, opening.lintel
    near, far = _WALL * 0.4, _WALL * 0.4 + 0.05
    uprights, levels = [a, b - 0.05], [d - 0.05]
    parts = [box((x, near, c), (x + 0.05, far, d)) for x in uprights]
    if c > 0:
        levels.append(c)
        inner = np.linspace(a, b, max(round((b - a) / 0.45), 1) + 1)[1:-1]
        parts += [box((x - _BAR / 2, near, c), (x + _BAR / 2, near + _BAR, d)) for x in inner]
        parts += [box((a, near, z - _BAR / 2), (b, near + _BAR, z + _BAR / 2)) for z in np.linspace(c, d, 5)[1:-1]]
    return join(parts + [box((a, near, z), (b, far, z + 0.05)) for z in levels])


def _skirting(plan: FloorPlan, wall: int, openings: list[Opening]) -> Shape:
    """Skirting boards of 8 cm along a wall, 1 cm thick, except at doors."""
    half, edge = _lengths(plan, wall)[0] / 2, -_lengths(plan, wall)[0] / 2
    ends = []
    for opening in (opening for opening in openings if opening.sill == 0):
        ends.append((edge, opening.left))
        edge = opening.right
    return join(box((a, -0.01, 0.0), (b, 0.0, 0.08)) for a, b in [*ends, (edge, half)])


def _blind(opening: Opening) -> Shape:
    """Slats of 2 mm in front of the upper half of a window, tilted so that light passes."""
    heights = np.arange((opening.sill + opening.lintel) / 2, opening.lintel - 0.06, 0.035)
    slat = box((opening.left + 0.06, -0.0125, -_SLAT / 2), (opening.right - 0.06, 0.0125, _SLAT / 2)).turned(
        0.5, axis=0
    )
    return join(slat.moved((0.0, _WALL * 0.2, float(height))) for height in heights)


def _planks(rng: np.random.Generator, size: int = 1024, rows: int = 14) -> np.ndarray:
    """Picture (size, size, 3) of planks with joints, each of its own tone."""
    v, u = np.mgrid[0:size, 0:size] / size
    row = np.floor(v * rows).astype(int)
    shifted = (u * 2 + 0.37 * row) % 2
    tone = rng.uniform(0.8, 1.12, (rows, 2))[row, np.floor(shifted).astype(int) % 2]
    joint = (np.abs(v * rows % 1 - 0.5) > 0.485) | (shifted % 1 < 0.004)
    picture = textures.wood(rng, rng.uniform((0.42, 0.30, 0.20), (0.68, 0.52, 0.36)).tolist(), size) * tone[..., None]
    return np.where(joint[..., None], picture * 0.45, picture)


_GATE = 1.2  # metres, in the fence at -y
_PICKET, _PITCH = 0.014, 0.11


def build_yard(collection: bpy.types.Collection, plan: FloorPlan, rng: np.random.Generator) -> None:
    """Build lawn, path, grass and fence of a garden's plan."""
    x, y = plan.width / 2 + 0.4, plan.depth / 2 + 0.4
    lawn = principled("Lawn", image=to_image("Lawn", textures.plaster(rng, (0.34, 0.46, 0.22), 512)))
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
    """Path of 6 mm slabs from the gate inwards, so low that pieces on it stay level."""
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
    ]  # distance, direction, and sections along the side
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
