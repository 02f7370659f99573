# SPDX-License-Identifier: GPL-3.0-or-later
"""Plants: cards with alpha-cut leaves in pots (instanced collections), a citrus tree, bougainvillea on the wall."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np

from .geometry import Shape, ball, join, lathe, place, show_collection, solidify, tube
from .masonry import ARCADE_Y, INSIDE, PLINTH, Materials


def cards(
    roots: np.ndarray,
    directions: np.ndarray,
    lengths: np.ndarray,
    width: float,
    bend: np.ndarray,
    rng: np.random.Generator,
) -> Shape:
    """Bent leaf cards, one per root (n, 3): they start along `directions` and sink by `bend` (n,) of their length."""
    count, rows = len(roots), 4
    along = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    across = np.cross(along, rng.normal(0, 1, (count, 3)) * (0.6, 0.6, 0.6) + (0, 0, 1.2))
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-6)
    t = np.linspace(0, 1, rows)
    spine = roots[:, None] + along[:, None] * (lengths[:, None] * t)[..., None]
    spine[..., 2] -= bend[:, None] * lengths[:, None] * t**2
    half = across[:, None] * (lengths * width / 2)[:, None, None]
    points = np.stack([spine - half, spine + half], axis=2)  # (count, rows, 2, 3)
    points[..., 2] = np.maximum(points[..., 2], 0.02)  # long fronds come to lie on the floor
    number = np.arange(count * rows * 2).reshape(count, rows, 2)
    quads = np.stack([number[:, :-1, 0], number[:, :-1, 1], number[:, 1:, 1], number[:, 1:, 0]], -1).reshape(-1, 4)
    uv = np.broadcast_to(np.stack(np.meshgrid([0.0, 1.0], t), -1), (count, rows, 2, 2)).reshape(-1, 2)
    return Shape(points.reshape(-1, 3), [tuple(quad) for quad in quads.tolist()], uv)


def _sphere(rng: np.random.Generator, count: int) -> np.ndarray:
    """Unit vectors (count, 3)."""
    vectors = rng.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def bush(
    rng: np.random.Generator,
    count: int,
    radius: Sequence[float],
    centre: Sequence[float],
    size: float,
    width: float = 0.8,
) -> Shape:
    """Cards over an ellipsoid of half axes `radius`, pointing outwards and up."""
    outward = _sphere(rng, count)
    roots = outward * radius * rng.uniform(0.45, 0.95, (count, 1)) + centre
    directions = outward + rng.normal(0, 0.35, (count, 3)) + (0, 0, 0.45)
    return cards(roots, directions, size * rng.uniform(0.7, 1.2, count), width, rng.uniform(0.1, 0.5, count), rng)


def fronds(rng: np.random.Generator, count: int, centre: Sequence[float], length: float) -> Shape:
    """Long arching fronds from one point."""
    angle = np.arange(count) * 2.39996 + rng.normal(0, 0.1, count)
    rise = rng.uniform(0.5, 2.4, count)
    directions = np.stack([np.cos(angle), np.sin(angle), rise], -1)
    roots = np.tile(centre, (count, 1)).astype(float)
    return cards(roots, directions, length * rng.uniform(0.75, 1.1, count), 0.36, rng.uniform(0.5, 0.9, count), rng)


def _potted(
    name: str, materials: Materials, leaves: list[tuple[str, Shape]], radius: float, height: float
) -> bpy.types.Collection:
    plant = bpy.data.collections.new(name)
    profile = [(0.66, 0.0), (0.7, 0.02), (0.93, 0.78), (1.0, 0.82), (1.06, 0.85), (1.06, 0.98), (1.0, 1.0)]
    shape = lathe([(radius * r, height * z) for r, z in profile], 32)
    solidify(place(plant, "Pot", shape, materials["clay"], smooth=True), 0.02, rim_only=True)
    soil = lathe([(radius * 0.98, 0.9 * height), (radius * 0.5, 0.93 * height), (0.01, 0.95 * height)], 20)
    place(plant, "Soil", soil, materials["soil"], smooth=True)
    for key, shape in leaves:
        place(plant, f"{name} {key}", shape, materials[key])
    return plant


def make_pots(materials: Materials, rng: np.random.Generator) -> dict[str, bpy.types.Collection]:
    """Potted plants, as collections to instance; the pots stand at the origin."""
    box_ball = bush(rng, 340, (0.3, 0.3, 0.3), (0, 0, 0.72), 0.15)
    lavender = bush(rng, 100, (0.16, 0.16, 0.1), (0, 0, 0.32), 0.32, 0.45)
    lavender.vertices[:, 2] += 0.35 * (lavender.vertices[:, 2] - 0.32)
    green = bush(rng, 170, (0.24, 0.24, 0.16), (0, 0, 0.42), 0.17)
    red = bush(rng, 70, (0.27, 0.27, 0.2), (0, 0, 0.5), 0.13)
    crown = bush(rng, 820, (0.46, 0.46, 0.5), (0, 0, 1.72), 0.205, 0.6)
    olive = _potted("Olive", materials, [("olive", crown)], 0.27, 0.46)
    trunk = np.array([(0, 0, 0.4), (0.02, 0.01, 0.8), (-0.02, 0.02, 1.2), (0, 0, 1.5)])
    olive_trunk = tube(trunk, np.array([0.045, 0.04, 0.035, 0.02]), 8)
    place(olive, "Olive trunk", olive_trunk, materials["bark"], smooth=True)
    return {
        "box": _potted("Box", materials, [("citrus", box_ball)], 0.25, 0.44),
        "lavender": _potted("Lavender", materials, [("lavender", lavender)], 0.18, 0.3),
        "geranium": _potted("Geranium", materials, [("citrus", green), ("geranium", red)], 0.2, 0.34),
        "fern": _potted("Fern", materials, [("fern", fronds(rng, 40, (0, 0, 0.38), 0.85))], 0.24, 0.4),
        "olive": olive,
    }


def build_pots(collection: bpy.types.Collection, materials: Materials, rng: np.random.Generator) -> None:
    """Potted plants on the steps, before the arcade, along the walls and by the gate."""
    pots = make_pots(materials, rng)
    spots = [
        *[
            ("olive", -3.55, 1.85, 1.15),
            ("olive", 3.55, 1.85, 1.1),
            ("fern", -4.75, 1.95, 1.1),
            ("fern", 4.8, 0.4, 1.1),
        ],
        *[("geranium", -2.65, 1.92, 1.0), ("geranium", 2.62, 1.98, 1.05), ("geranium", 4.3, 1.7, 0.9)],
        *[("lavender", -4.2, 1.55, 1.2), ("box", -4.95, 0.9, 1.0), ("geranium", -4.95, 0.1, 1.0)],
        *[("lavender", -5.0, -0.4, 1.0), ("fern", -4.85, -1.7, 1.0), ("box", -4.9, -2.6, 1.1)],
        *[("geranium", -4.95, -3.3, 0.95), ("lavender", 5.0, -0.35, 1.1), ("geranium", 4.95, -2.3, 1.05)],
        *[("box", 4.8, -3.2, 1.15), ("box", 0.5, -3.8, 0.9), ("box", 3.6, -3.75, 0.9), ("lavender", -0.2, -3.95, 1.0)],
    ]
    for name, x, y, scale in spots:
        show_collection(collection, pots[name], (x, y, 0.03), rng.uniform(0, 6.28), scale * rng.uniform(0.95, 1.05))
    low = PLINTH / 3
    for name, x, level, y in (("geranium", -2.55, 2, 2.42), ("lavender", 2.55, 2, 2.42), ("geranium", 2.6, 1, 2.06)):
        show_collection(collection, pots[name], (x, y, low * level + 0.03), rng.uniform(0, 6.28), 0.8)
    for name, x in (("fern", -0.0), ("fern", -4.9), ("fern", 4.9), ("box", -1.2), ("box", 1.2)):
        y = 5.05 if name == "box" else 4.95
        if x:
            show_collection(collection, pots[name], (x, y, PLINTH + 0.03), rng.uniform(0, 6.28), 0.95)


def build_tree(
    collection: bpy.types.Collection, materials: Materials, rng: np.random.Generator, x: float, y: float
) -> None:
    """Orange tree in a round bed of stone."""
    ring = [(0.62, 0.0), (0.62, 0.34), (0.66, 0.36), (0.66, 0.42), (0.5, 0.42), (0.5, 0.3)]
    place(collection, "Tree bed", lathe(ring, 40).moved((x, y, 0.0)), materials["brick"], repeat=0.8)
    soil = lathe([(0.52, 0.36), (0.2, 0.4), (0.01, 0.41)], 24).moved((x, y, 0))
    place(collection, "Tree soil", soil, materials["soil"], smooth=True)
    top = np.array([x + 0.1, y - 0.05, 1.55])
    trunk = np.array([(x, y, 0.36), (x + 0.06, y, 0.8), (x + 0.02, y - 0.04, 1.2), top])
    wood = [tube(trunk, np.array([0.1, 0.08, 0.07, 0.065]), 12)]
    tips = []
    for number in range(9):
        angle = number * 2.39996
        reach = np.array([np.cos(angle), np.sin(angle), 0.75 + 0.5 * (number % 3)]) * rng.uniform(0.55, 0.8)
        bough = np.array([top, top + 0.5 * reach + (0, 0, 0.1), top + reach])
        wood.append(tube(bough, np.array([0.045, 0.03, 0.016]), 8))
        tips.append(top + 1.05 * reach)
    place(collection, "Tree wood", join(wood), materials["bark"], smooth=True)
    crowns = [bush(rng, 110, (0.48, 0.48, 0.38), tip, 0.26, 0.75) for tip in tips]
    place(collection, "Tree leaves", join(crowns), materials["citrus"])
    fruit = [ball(0.045, 12).moved(tips[k % 9] + _sphere(rng, 1)[0] * (0.5, 0.5, 0.4)) for k in range(42)]
    place(collection, "Oranges", join(fruit), materials["orange"], smooth=True)


def build_bougainvillea(collection: bpy.types.Collection, materials: Materials, rng: np.random.Generator) -> None:
    """Climber that rises in the right corner and hangs over the arcade's eaves and the wall."""
    corner = (INSIDE - 0.15, ARCADE_Y - 0.22)
    up = np.array([(corner[0], corner[1], z) for z in (0.4, 1.2, 2.2, 3.2, 4.3)])
    eaves = np.array([(x, 2.25, z) for x, z in ((5.2, 4.35), (4.4, 4.5), (3.5, 4.48), (2.6, 4.4), (1.9, 4.3))])
    heights = ((2.4, 2.55), (1.6, 2.45), (0.8, 2.3), (0.0, 2.25), (-0.8, 2.15))
    wall = np.array([(INSIDE + 0.05, y, z) for y, z in heights])
    stems = [tube(path + rng.normal(0, 0.05, path.shape), np.linspace(0.035, 0.01, 5), 7) for path in (up, eaves, wall)]
    place(collection, "Bougainvillea stems", join(stems), materials["bark"], smooth=True)
    for name, material, clusters in (
        ("blossoms", "bougainvillea", ((up[1:], 150, 0.22), (eaves, 520, 0.3), (wall, 400, 0.26))),
        ("leaves", "citrus", ((up[1:], 120, 0.2), (eaves, 260, 0.27), (wall, 220, 0.24))),
    ):
        cards_around = join(_cascade(rng, *cluster) for cluster in clusters)
        place(collection, f"Bougainvillea {name}", cards_around, materials[material])


def _cascade(rng: np.random.Generator, path: np.ndarray, count: int, spread: float) -> Shape:
    """Cards around a path that lean out into the courtyard and hang down."""
    t = rng.uniform(0, len(path) - 1, count)
    index = np.minimum(t.astype(int), len(path) - 2)
    roots = path[index] + (path[index + 1] - path[index]) * (t - index)[:, None]
    hang = rng.exponential(0.9, count) * spread * (1 + 0.5 * np.sin(5 * t))
    roots = roots + rng.normal(0, 0.5, (count, 3)) * spread - np.stack([0 * t, 0.3 * hang, 0.8 * hang], -1)
    inward = np.array([0.0, 0.6, 0.0]) - roots * (1, 1, 0)
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    directions = 0.8 * inward + _sphere(rng, count) * 0.8 + (0, 0, 0.1)
    return cards(roots, directions, rng.uniform(0.14, 0.24, count), 0.95, rng.uniform(0.2, 0.8, count), rng)
