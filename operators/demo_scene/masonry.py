# SPDX-License-Identifier: GPL-3.0-or-later
"""Masonry of the courtyard: floor, steps, walls, arcade and roofs."""

from __future__ import annotations

import bpy
import numpy as np

from .geometry import Shape, array, bevel, box, join, lathe, place, scatter, sheet, solidify

Materials = dict[str, bpy.types.Material]

INSIDE = 5.4  # half the inner width, and where the house begins
FRONT = -4.5  # the courtyard's open side
WALL = 0.3
PLINTH = 0.45  # height of the arcade's floor
ARCADE_Y = 2.7  # front of the arcade
SPRING = 2.45  # height where the arches begin
BAY = 2.7
ARCH_RADIUS = 1.1


def arch_wall(
    x0: float,
    x1: float,
    z0: float,
    z1: float,
    openings: list[tuple[float, float, float, float]],
    thickness: float,
    back: bool = True,
) -> Shape:
    """Wall in the xz plane, from y = 0 back to `thickness`, with arched openings (centre, radius, sill, spring).

    Without its back it is a facade with reveals.
    """
    pieces, edge = [], x0
    for centre, radius, sill, spring in sorted(openings):
        pieces.append(_rectangle(edge, centre - radius, z0, z1))
        if sill > z0:
            pieces.append(_rectangle(centre - radius, centre + radius, z0, sill))
        arch = _arch(centre, radius, spring, np.linspace(np.pi, 0, 25))
        pieces.append(sheet(np.stack([arch, np.stack([arch[:, 0], arch[:, 1], np.full(25, z1)], -1)])))
        edge = centre + radius
    pieces.append(_rectangle(edge, x1, z0, z1))
    front = join(piece for piece in pieces if np.ptp(piece.vertices[:, 0]) > 1e-6)
    faces = [front] + [Shape(front.vertices + (0, thickness, 0), [face[::-1] for face in front.faces])] * back
    feet = [x0]
    for centre, radius, sill, _ in sorted(openings):
        feet += [centre - radius, centre + radius] if sill <= z0 else []
    feet.append(x1)
    rims = [np.array([[a, 0, z0], [b, 0, z0]]) for a, b in zip(feet[::2], feet[1::2], strict=True)]
    rims += [np.array([[x1, 0, z0], [x1, 0, z1], [x0, 0, z1], [x0, 0, z0]])]
    rims += [_outline(*opening, floor=opening[2] > z0)[::-1] for opening in openings]
    whole = join(faces + [sheet(np.stack([rim + (0, thickness, 0), rim])) for rim in rims])
    return Shape(whole.vertices, whole.faces)


def _rectangle(x0: float, x1: float, z0: float, z1: float) -> Shape:
    return sheet(np.array([[[x0, 0, z0], [x1, 0, z0]], [[x0, 0, z1], [x1, 0, z1]]]))


def _outline(centre: float, radius: float, sill: float, spring: float, floor: bool) -> np.ndarray:
    """Edge of an opening (n, 3), from its right foot over the arch to the left one, and back along a sill."""
    arch = _arch(centre, radius, spring, np.linspace(0, np.pi, 25))
    feet = np.array([[centre + radius, 0, sill], [centre - radius, 0, sill]])
    parts = [feet[:1]] * (spring > sill) + [arch] + [feet[1:]] * (spring > sill)
    return np.concatenate(parts + ([feet[:1]] if floor else []))


def _arch(centre: float, radius: float, spring: float, angles: np.ndarray) -> np.ndarray:
    return np.stack([centre + radius * np.cos(angles), 0 * angles, spring + radius * np.sin(angles)], -1)


def build_floor(collection: bpy.types.Collection, materials: Materials, rng: np.random.Generator) -> None:
    """Kerb around instanced tiles in a chequer of warm tones."""
    edges = [((-6, FRONT - 0.22), (6, FRONT)), ((-6, FRONT), (-INSIDE - 0.25, 5.7)), ((INSIDE + 0.25, FRONT), (6, 5.7))]
    kerbs = [box((*low, -0.2), (*high, 0), False) for low, high in edges]
    place(collection, "Kerb", join(kerbs), materials["stone"], repeat=2.5)
    size = 0.3
    prototypes = []
    hidden = bpy.data.collections.new("Floor tile prototypes")
    for number in range(4):
        shape = box((-size / 2, -size / 2, 0), (size / 2, size / 2, 0.01), False)
        tile = place(hidden, f"Floor tile {number + 1}", shape, materials[f"floor{number}"])
        bevel(tile, 0.007)
        prototypes.append(tile)
    i, j = (axis.ravel() for axis in np.meshgrid(np.arange(36), np.arange(24), indexing="ij"))
    kind = np.where((i + j) % 2 == 0, 3, rng.integers(0, 3, len(i)))
    kind = np.where(rng.random(len(i)) < 0.12, rng.integers(0, 4, len(i)), kind)
    points = np.stack([-INSIDE + size * (i + 0.5), FRONT + size * (j + 0.5), rng.normal(0, 0.001, len(i))], -1)
    tilts = rng.normal(0, 0.003, (len(i), 3)) * (1, 1, 0)
    for number, tile in enumerate(prototypes):
        mine = kind == number
        scatter(collection, f"Floor {number + 1}", tile, points[mine], tilts[mine])


def build_steps(collection: bpy.types.Collection, materials: Materials) -> None:
    """Arcade's plinth and three steps in front of its middle, with glazed risers."""
    low, front = PLINTH / 3, ARCADE_Y - 0.12
    solid = box((-INSIDE, front, 0), (INSIDE, INSIDE, PLINTH))
    seen = Shape(solid.vertices, solid.faces[:1] + solid.faces[3:4])  # top and front
    place(collection, "Plinth", seen, materials["stone"], repeat=2.0)
    for number in range(3):
        y, top = front - 0.36 * (2 - number), low * (number + 1)
        if number < 2:
            step = box((-2.9, y, 0), (2.9, front, top), False)
            place(collection, f"Step {number + 1}", step, materials["stone"], repeat=2.0)
        reach = INSIDE if number == 2 else 2.9
        tread = box((-reach - 0.02 * (number < 2), y - 0.035, top), (reach + 0.02 * (number < 2), y + 0.34, top + 0.03))
        bevel(place(collection, f"Tread {number + 1}", tread, materials["stone"], repeat=1.5), 0.012, 3)
        ends = np.array([(-2.85, y - 0.008, top), (2.85, y - 0.008, top)])
        riser = sheet(np.stack([ends - (0, 0, low - 0.02), ends]))
        place(collection, f"Riser {number + 1}", riser.repeated(5.7 / 0.26, 0.5), materials["glaze"])


def build_walls(collection: bpy.types.Collection, materials: Materials) -> None:
    """Brick wall on the left with an opening, plaster wall on the right, the house behind."""
    side = arch_wall(FRONT, ARCADE_Y, 0, 2.6, [(-1.0, 0.62, 1.0, 1.75)], WALL).turned(np.pi / 2)
    place(collection, "Brick wall", side.moved((-INSIDE, 0, 0)), materials["brick"], repeat=1.6)
    right = box((INSIDE, FRONT, 0), (INSIDE + WALL, ARCADE_Y, 2.15), False)
    place(collection, "Plaster wall", right, materials["ochre"], repeat=3.2)
    for name, x, height in (("left", -INSIDE - WALL / 2, 2.6), ("right", INSIDE + WALL / 2, 2.15)):
        stone = box((x - 0.21, FRONT - 0.03, height), (x + 0.21, FRONT + 0.56, height + 0.09))
        coping = place(collection, f"Coping {name}", stone, materials["stone"])
        bevel(coping, 0.02, 3)
        array(coping, 12, (0, (ARCADE_Y - FRONT + 0.02) / 12, 0))
        _gable(collection, f"Arcade end {name}", x, materials["ochre" if x > 0 else "brick"])
    lower = arch_wall(-INSIDE, INSIDE, PLINTH, 5.1, [(0.0, 0.75, PLINTH, 2.1)], WALL, back=False)
    place(collection, "Back wall", lower.moved((0, INSIDE, 0)), materials["ochre"], repeat=3.2)
    windows = [(x, 0.42, 5.65, 6.2) for x in (-3.3, 0.0, 3.3)]
    upper = arch_wall(-INSIDE - WALL, INSIDE + WALL, 5.1, 7.1, windows, WALL, back=False)
    place(collection, "Upper wall", upper.moved((0, INSIDE, 0)), materials["plaster"], repeat=3.2)
    for x, _, sill, _ in windows:
        frame = box((x - 0.56, INSIDE - 0.07, sill - 0.09), (x + 0.56, INSIDE + 0.1, sill))
        bevel(place(collection, "Window sill", frame, materials["stone"]), 0.015)
    place(collection, "Cornice", _cornice(), materials["stone"], repeat=2.0)
    rooms = [box((x - 0.45, INSIDE + WALL, 5.6), (x + 0.45, INSIDE + WALL + 0.02, 6.7)) for x, _, _, _ in windows]
    place(collection, "Dark rooms", join(rooms), materials["dark"])


def _cornice() -> Shape:
    """Moulding along the top of the upper wall: three fillets."""
    side = INSIDE + WALL
    rows = [(0.05, 6.86, 6.93), (0.1, 6.93, 7.02), (0.16, 7.02, 7.1)]
    fillets = [box((-side - out, INSIDE - out, low), (side + out, INSIDE, high)) for out, low, high in rows]
    return join(Shape(fillet.vertices, fillet.faces[1:4] + fillet.faces[5:]) for fillet in fillets)  # no top, no back


def _gable(collection: bpy.types.Collection, name: str, x: float, material: bpy.types.Material) -> None:
    """Wall that closes the arcade at one side, under the slope of its roof."""
    profile = np.array([(ARCADE_Y, 0.0), (5.7, 0.0), (5.7, 5.1), (INSIDE, 5.1), (ARCADE_Y, 4.24)])
    rings = [np.column_stack([np.full(5, x + side * WALL / 2), profile]) for side in (-1, 1)]
    shape = sheet(np.stack(rings), closed=True)
    shape.faces += [tuple(range(5))[::-1], tuple(range(5, 10))]
    place(collection, name, Shape(shape.vertices, shape.faces), material, repeat=1.6)


def build_arcade(collection: bpy.types.Collection, materials: Materials) -> None:
    """Four arches on columns, with rings of stones around them."""
    centres = [BAY * (number - 1.5) for number in range(4)]
    wall = arch_wall(-INSIDE, INSIDE, SPRING, 4.3, [(x, ARCH_RADIUS, SPRING, SPRING) for x in centres], 0.36)
    place(collection, "Arcade", wall.moved((0, ARCADE_Y, 0)), materials["plaster"], repeat=3.2)
    stones = place(collection, "Arch stones", _arch_stones(), materials["stone"], repeat=0.9)
    stones.location = (centres[0], ARCADE_Y - 0.035, SPRING)
    bevel(stones, 0.012)
    array(stones, 4, (BAY, 0, 0))
    column = place(collection, "Column", _column(), materials["stone"], smooth=True)
    column.location = (-BAY, ARCADE_Y + 0.18, PLINTH)
    array(column, 3, (BAY, 0, 0))
    blocks = [box((-0.25, -0.25, 0), (0.25, 0.25, 0.12)), box((-0.25, -0.25, 1.86), (0.25, 0.25, 2.0))]
    base = place(collection, "Column blocks", join(blocks), materials["stone"])
    base.location = column.location
    bevel(base, 0.02, 3)
    array(base, 3, (BAY, 0, 0))
    for x in (-INSIDE, INSIDE):
        low, high = sorted((x, x - np.sign(x) * 0.25))
        pier = box((low, ARCADE_Y, PLINTH), (high, ARCADE_Y + 0.36, SPRING))
        place(collection, "Pier", pier, materials["plaster"], repeat=3.2)


def _arch_stones() -> Shape:
    """Seventeen wedge stones around one arch, centre in the origin; the key stone is longer."""
    edges = np.linspace(0, np.pi, 18)
    stones = []
    for number, (start, end) in enumerate(zip(edges[:-1] + 0.006, edges[1:] - 0.006, strict=True)):
        outer = ARCH_RADIUS + (0.36 if number == 8 else 0.24)
        inner = ARCH_RADIUS - 0.012
        ring = ((inner, start), (outer, start), (outer, end), (inner, end))
        front = np.array([(radius * np.cos(angle), 0, radius * np.sin(angle)) for radius, angle in ring])
        shape = sheet(np.stack([front + (0, 0.2, 0), front]), closed=True)
        stones.append(Shape(shape.vertices, shape.faces + [(4, 5, 6, 7)[::-1], (0, 1, 2, 3)]))
    return join(stones)


def _column() -> Shape:
    """Column of 2 m with base, swelling shaft and capital."""
    base = [
        (0.24, 0.12), (0.245, 0.15), (0.24, 0.18), (0.2, 0.2), (0.2, 0.22), (0.215, 0.24), (0.2, 0.27), (0.17, 0.29),
    ]  # fmt: skip
    shaft = [(0.165 - 0.03 * t**1.8, 0.3 + 1.24 * t) for t in np.linspace(0, 1, 12)]
    capital = [
        (0.155, 1.56), (0.16, 1.58), (0.14, 1.6), (0.14, 1.66), (0.15, 1.7), (0.18, 1.77), (0.22, 1.82),
        (0.24, 1.86),
    ]  # fmt: skip
    return lathe(base + shaft + capital, 32)


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
    angles, t = np.linspace(0, np.pi, 13), np.linspace(0, 1, 4)[:, None]
    radius = 0.105 - 0.02 * t
    rows = np.stack([radius * np.cos(angles), 0 * angles + 0.46 * t, radius * np.sin(angles)], -1)
    return sheet(rows[:, ::-1])


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
    across = (j - (columns - 1) / 2) * 2 * width / columns
    points = np.stack([across, front[0] + along * run[0], front[1] + along * run[1] + 0.012 * (i > 0)], -1)
    angles = np.stack([slope + rng.normal(-0.035, 0.008, len(i)), 0 * i, rng.normal(0, 0.015, len(i))], -1)
    kind = rng.integers(0, len(prototypes), len(i))
    for number, tile in enumerate(prototypes):
        mine = kind == number
        scatter(collection, f"{name} roof {number + 1}", tile, points[mine], angles[mine])
