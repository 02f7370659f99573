# SPDX-License-Identifier: GPL-3.0-or-later
"""Shell of a room: floor of planks, ceiling, walls with openings, window bars, blinds, door frame, skirting."""

from __future__ import annotations

import math
from itertools import pairwise

import bpy
import numpy as np

from ...patchnet_addon.furniture.floor_plan import FloorPlan
from ...patchnet_addon.furniture.interior import Opening, Room
from ..demo_scene import textures
from ..demo_scene.geometry import Shape, box, join, place
from ..demo_scene.materials import principled

_WALL = 0.16  # metres
_BAR, _SLAT = 0.028, 0.002
_PALETTE = ((0.90, 0.87, 0.80), (0.76, 0.83, 0.84), (0.86, 0.76, 0.66), (0.80, 0.85, 0.74), (0.92, 0.91, 0.89))


def build_shell(collection: bpy.types.Collection, room: Room, rng: np.random.Generator) -> None:
    """Build floor, ceiling and four walls around a room's plan, closed but for its openings."""
    plan = room.plan
    x, y = plan.width / 2 + _WALL, plan.depth / 2 + _WALL
    planks = principled("Planks", image=textures.to_image("Planks", _planks(rng)), roughness=0.7)
    white = principled("White paint", (0.93, 0.92, 0.90))
    place(collection, "Floor", box((-x, -y, -_WALL), (x, y, 0.0)), planks, repeat=2.0)
    place(collection, "Ceiling", box((-x, -y, plan.height), (x, y, plan.height + _WALL)), white)
    colours = rng.permutation(len(_PALETTE))
    for wall in range(4):
        openings = [opening for opening in room.openings if opening.wall == wall]
        paint = principled(f"Wall {wall + 1}", _PALETTE[colours[0 if wall % 2 else 1]])
        place(collection, f"Wall {wall + 1}", _set(plan, wall, _wall(plan, wall, openings)), paint)
        trims = [_trim(opening) for opening in openings]
        trims += [_skirting(plan, wall, openings)]
        place(collection, f"Frames {wall + 1}", _set(plan, wall, join(trims)), white)
        for number, opening in enumerate(opening for opening in openings if opening.sill > 0 and wall):
            place(collection, f"Blind {wall + 1}.{number}", _set(plan, wall, _blind(opening)), white)


def _lengths(plan: FloorPlan, wall: int) -> tuple[float, float]:
    """Length of a wall, and its distance from the middle of the room."""
    return (plan.width, plan.depth / 2) if wall % 2 == 0 else (plan.depth, plan.width / 2)


def _set(plan: FloorPlan, wall: int, shape: Shape) -> Shape:
    """Set a shape, whose x is along the wall and y from its inner face outwards, to its wall."""
    return shape.moved((0.0, _lengths(plan, wall)[1], 0.0)).turned(wall * math.pi / 2)


def _wall(plan: FloorPlan, wall: int, openings: list[Opening]) -> Shape:
    """Wall around its openings, in cells without faces between them; walls at +y and -y reach over the corners."""
    half = _lengths(plan, wall)[0] / 2 + (_WALL if wall % 2 == 0 else 0.0)
    x = sorted({-half, half, *(end for opening in openings for end in (opening.left, opening.right))})
    z = sorted({0.0, plan.height, *(end for opening in openings for end in (opening.sill, opening.lintel))})
    solid = np.zeros((len(x) + 1, len(z) + 1), bool)  # with a border of air
    solid[1:-1, 1:-1] = [
        [not _is_open(openings, (a + b) / 2, (c + d) / 2) for c, d in pairwise(z)] for a, b in pairwise(x)
    ]
    cells = []
    for i, k in np.argwhere(solid).tolist():
        cell = box((x[i - 1], 0.0, z[k - 1]), (x[i], _WALL, z[k]))
        # Faces of a box: +x and -x are its third and second, +z and -z its first and last.
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
    """Board of 8 cm along the foot of a wall, 1 cm thick, but not before doors."""
    half, edge = _lengths(plan, wall)[0] / 2, -_lengths(plan, wall)[0] / 2
    ends = []
    for opening in (opening for opening in openings if opening.sill == 0):
        ends.append((edge, opening.left))
        edge = opening.right
    return join(box((a, -0.01, 0.0), (b, 0.0, 0.08)) for a, b in [*ends, (edge, half)])


def _blind(opening: Opening) -> Shape:
    """Slats of 2 mm before the upper half of a window, tilted, so that light falls through."""
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
