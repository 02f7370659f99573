# SPDX-License-Identifier: GPL-3.0-or-later
"""Shapes of procedural structures, each about a metre wide around the origin; the thickness of parts is given."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..demo_scene.geometry import Shape, ball, box, join, sheet, tube

_HALF = 0.6  # metres from the middle to an edge
_MOST = 80  # parts along one axis: finer ones only cover less of the metre


def bars(rng: np.random.Generator, thick: float) -> Shape:
    """Round or square bars side by side, at one to five thicknesses from each other."""
    places = _places(thick * rng.uniform(2.0, 6.0))
    if rng.random() < 0.5:
        half = thick / 2
        return join(box((x - half, -half, -_HALF), (x + half, half, _HALF)) for x in places)
    return join(tube(np.array([(x, 0.0, -_HALF), (x, 0.0, _HALF)]), thick / 2, 7) for x in places)


def slats(rng: np.random.Generator, thick: float) -> Shape:
    """Tilted boards above each other, as of a blind."""
    wide, tilt = thick * rng.uniform(2.0, 8.0), rng.uniform(-1.4, 1.4)
    board = box((-_HALF, -wide / 2, -thick / 2), (_HALF, wide / 2, thick / 2)).turned(tilt, 0)
    return join(board.moved((0.0, 0.0, z)) for z in _places(wide * rng.uniform(0.7, 2.0)))


def wires(rng: np.random.Generator, thick: float) -> Shape:
    """Mesh of two layers of wires that cross, or a plate with square holes where they lie in one."""
    pitch, half = thick * rng.uniform(2.0, 10.0), thick / 2
    places, behind = _places(pitch), rng.choice([0.0, 0.8]) * thick
    across = [box((-_HALF, behind - half, z - half), (_HALF, behind + half, z + half)) for z in places]
    return join(across + [box((x - half, -half, -_HALF), (x + half, half, _HALF)) for x in places])


def lattice(rng: np.random.Generator, thick: float) -> Shape:
    """Bars along all three axes, as of a scaffold."""
    places = _places(max(thick * rng.uniform(3.0, 12.0), 0.09))
    half, parts = thick / 2, []
    for a in places:
        for b in places:
            for axis in range(3):
                low, high = np.empty(3), np.empty(3)
                low[axis], high[axis] = -_HALF, _HALF
                rest = [k for k in range(3) if k != axis]
                low[rest], high[rest] = np.array([a, b]) - half, np.array([a, b]) + half
                parts.append(box(low.tolist(), high.tolist()))
    return join(parts)


def leaves(rng: np.random.Generator, thick: float) -> Shape:
    """Pointed quads in all directions, as of a bush; `thick` is half of their length."""
    count = int(np.clip(0.05 / thick**1.5, 60, 6000))
    middle = rng.normal(0.0, 0.28, (count, 3))
    along, across = rng.normal(0.0, 1.0, (2, count, 3))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across -= along * (across * along).sum(axis=1, keepdims=True)
    across *= rng.uniform(0.25, 0.7) / np.linalg.norm(across, axis=1, keepdims=True)
    length = thick * rng.uniform(0.7, 1.4, (count, 1))
    corners = np.stack([along, across, -along, -across], axis=1) * length[:, None] + middle[:, None]
    number = np.arange(4 * count).reshape(count, 4)
    return Shape(corners.reshape(-1, 3), [tuple(face) for face in number.tolist()])


def folds(rng: np.random.Generator, thick: float) -> Shape:
    """Cloth that hangs in folds, about as deep as they are wide."""
    wave = 4.0 * thick * rng.uniform(1.0, 3.0)
    columns = int(np.clip(16 * 2 * _HALF / wave, 60, 1500))
    x, z = np.meshgrid(np.linspace(-_HALF, _HALF, columns), np.linspace(-_HALF, _HALF, 12))
    phase = 2 * np.pi * x / wave + 0.6 * np.sin(3.0 * x + rng.uniform(0, 6)) + 0.3 * z
    y = wave * rng.uniform(0.15, 0.6) * np.sin(phase) * (1.0 + 0.2 * np.sin(7.0 * z))
    return sheet(np.stack([x, y, z], axis=-1))


def debris(rng: np.random.Generator, thick: float) -> Shape:
    """Blocks and balls of many sizes on no grid, as of gravel."""
    parts = []
    for _ in range(int(np.clip(0.02 / thick**1.5, 40, 700))):
        size = thick * rng.uniform(0.5, 2.0, 3)
        part = ball(float(size[0]), 8) if rng.random() < 0.4 else box((-size).tolist(), size.tolist())
        turned = part.turned(rng.uniform(0, 3.1), 0).turned(rng.uniform(0, 3.1), 2)
        parts.append(turned.moved(rng.uniform(-_HALF, _HALF, 3).tolist()))
    return join(parts)


def panel(rng: np.random.Generator, thick: float) -> Shape:
    """Flat board, for chequers and text on it."""
    half = thick / 2
    return box((-_HALF, -half, -_HALF), (_HALF, half, _HALF))


def _places(pitch: float) -> np.ndarray:
    """Places of parts along an axis, at most `_MOST`, symmetric about 0."""
    reach = min(_HALF - pitch / 2, pitch * _MOST / 2)
    count = max(round(2 * reach / pitch), 1)
    return (np.arange(count) - (count - 1) / 2) * pitch


TEXT, CHEQUERS = "text", "chequers"
KINDS: dict[str, Callable[[np.random.Generator, float], Shape]] = {
    "bars": bars,
    "slats": slats,
    "wires": wires,
    "lattice": lattice,
    "leaves": leaves,
    "folds": folds,
    "debris": debris,
    CHEQUERS: panel,
    TEXT: panel,
}
