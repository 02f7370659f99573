# SPDX-License-Identifier: GPL-3.0-or-later
"""Ironwork far thinner than a distant pixel: fence, gate, grilles, scrolls, lantern."""

from __future__ import annotations

import bpy
import numpy as np

from .geometry import Shape, array, ball, bevel, box, curve, join, lathe, place, tube
from .masonry import BAY, FRONT, INSIDE, PLINTH, Materials

FENCE_Y = FRONT + 0.15
GATE = (0.9, 3.1)  # the gate's left and right post
_HEIGHT = 1.75
_BASE = 0.32


def scroll(size: float, turns: float = 1.35, points: int = 26) -> np.ndarray:
    """S of two spirals in the xz plane (2 points - 1, 3), `size` high, centre in the origin."""
    t = np.linspace(0, 1, points)
    angle = np.pi / 2 - 2 * np.pi * turns * (1 - t) ** 1.15
    radius = size / 4 * (0.22 + 0.78 * t)
    x, z = radius * np.cos(angle), radius * np.sin(angle)
    upper = np.stack([x - x[-1], 0 * x, z - z[-1]], -1)
    return np.concatenate([upper, -upper[-2::-1]])[:, [0, 1, 2]]


def build_fence(collection: bpy.types.Collection, materials: Materials) -> None:
    """Pickets of 14 mm with spear heads between stone posts, scrolls between two rails, on a low wall."""
    sections = [(-INSIDE, -2.25), (-2.25, GATE[0]), (GATE[1], INSIDE)]
    for number, (left, right) in enumerate(sections):
        _section(collection, materials, f"Fence {number + 1}", left + 0.18, right - 0.18)
    for x in (-INSIDE, -2.25, GATE[0], GATE[1], INSIDE):
        _post(collection, materials, x)


def _section(collection: bpy.types.Collection, materials: Materials, name: str, left: float, right: float) -> None:
    base = box((left - 0.05, FENCE_Y - 0.13, 0), (right + 0.05, FENCE_Y + 0.13, _BASE - 0.05))
    place(collection, f"{name} base", base, materials["plaster"], repeat=2.0)
    cap = box((left - 0.05, FENCE_Y - 0.17, _BASE - 0.05), (right + 0.05, FENCE_Y + 0.17, _BASE + 0.02))
    bevel(place(collection, f"{name} cap", cap, materials["stone"], repeat=1.2), 0.015)
    count = int((right - left) / 0.115)
    step = (right - left) / count
    picket = place(collection, f"{name} pickets", _picket(), materials["iron"])
    picket.location = (left + step / 2, FENCE_Y, _BASE)
    array(picket, count, (step, 0, 0))
    rails = [box((left, FENCE_Y - 0.016, z), (right, FENCE_Y + 0.016, z + 0.012)) for z in (0.42, 1.28, 1.52)]
    place(collection, f"{name} rails", join(rails), materials["iron"])
    small = scroll(0.215) * (0.75, 1, 1)
    paths = [small * (1 - 2 * (k % 2), 1, 1) + (left + step * (k + 1), FENCE_Y, 1.406) for k in range(count - 1)]
    curve(collection, f"{name} scrolls", paths, 0.0045, materials["iron"])


def _picket() -> Shape:
    """Square bar with a collar and a spear head, 1.43 m high."""
    head = lathe([(0.008, 1.27), (0.016, 1.285), (0.008, 1.30), (0.024, 1.335), (0.016, 1.37), (0.001, 1.43)], 8)
    collar = lathe([(0.008, 0.42), (0.017, 0.435), (0.008, 0.45)], 8)
    return join([box((-0.007, -0.007, 0), (0.007, 0.007, 1.28)), head, collar])


def _post(collection: bpy.types.Collection, materials: Materials, x: float) -> None:
    side = 0.19
    body = box((x - side, FENCE_Y - side, 0), (x + side, FENCE_Y + side, _HEIGHT + 0.1))
    bevel(place(collection, "Post", body, materials["plaster"], repeat=2.0), 0.012)
    cap = [(0.24, 0), (0.245, 0.03), (0.24, 0.06), (0.19, 0.08), (0.1, 0.11), (0.08, 0.13)]
    shape = lathe([(radius * 1.1, height) for radius, height in cap], 4).turned(np.pi / 4)
    place(collection, "Post cap", shape.moved((x, FENCE_Y, _HEIGHT + 0.1)), materials["stone"])
    ball_shape = ball(0.105, 20).moved((x, FENCE_Y, _HEIGHT + 0.31))
    place(collection, "Post ball", ball_shape, materials["stone"], smooth=True)


def build_gate(collection: bpy.types.Collection, materials: Materials) -> None:
    """Two leaves of chain-link in steel tubes, one ajar, under an arch of scrolls."""
    width = (GATE[1] - GATE[0]) / 2 - 0.22
    for name, x, angle in (("left", GATE[0] + 0.21, 0.0), ("right", GATE[1] - 0.21, np.pi - 0.62)):
        bars = join(tube(path, 0.019, 10) for path in _leaf_frame(width))
        frame = place(collection, f"Gate frame {name}", bars, materials["steel"], smooth=True)
        wires = [path + (0.02, 0, 0.12) for path in _chain_link(width - 0.04, 1.5)]
        mesh = curve(collection, f"Chain-link {name}", wires, 0.0025, materials["steel"], 0)
        for item in (frame, mesh):
            item.location, item.rotation_euler = (x, FENCE_Y, 0), (0, 0, angle)
    reach = (GATE[1] - GATE[0]) / 2 - 0.1
    angles = np.linspace(np.pi, 0, 40)
    arches = [_on_arch(radius, angles) for radius in (reach, reach - 0.26)]
    curve(collection, "Gate arch", arches, 0.011, materials["iron"])
    scrolls = []
    for number, angle in enumerate(np.linspace(np.pi - 0.17, 0.17, 13)):
        cos, sin = np.sin(angle), np.cos(angle)  # of the angle from upright
        turn = np.array([[cos, 0, -sin], [0, 1, 0], [sin, 0, cos]])
        path = scroll(0.25) * (1 - 2 * (number % 2), 1, 1) @ turn
        scrolls.append(path * (0.8, 1, 0.72) + _on_arch(reach - 0.13, np.array([angle])))
    curve(collection, "Gate scrolls", scrolls, 0.006, materials["iron"])


def _on_arch(radius: float, angles: np.ndarray) -> np.ndarray:
    """Points (n, 3) of a flat arch over the gate."""
    x = (GATE[0] + GATE[1]) / 2 + radius * np.cos(angles)
    return np.stack([x, 0 * angles + FENCE_Y, 1.86 + 0.62 * radius * np.sin(angles)], -1)


def _leaf_frame(width: float) -> list[np.ndarray]:
    corners = np.array([(x, 0, z) for x in (0, width) for z in (0.1, 1.64)])
    return [corners[[start, end]] for start, end in ((0, 1), (2, 3), (0, 2), (1, 3), (0, 3))]


def _chain_link(width: float, height: float, mesh: float = 0.05) -> list[np.ndarray]:
    """Zigzag wires (n, 3) that hook into each other, as in chain-link."""
    count, links = int(width / mesh), int(height / mesh) * 2
    z = np.linspace(0, height, links + 1)
    paths = []
    for k in range(count):
        swing = np.where(np.arange(links + 1) % 2 == 0, -1.0, 1.0) * (1 - 2 * (k % 2))
        x = (k + 0.5 + 0.53 * swing) * width / count
        paths.append(np.stack([np.clip(x, 0, width), 0.004 * swing, z], -1))
    return paths


def build_grilles(collection: bpy.types.Collection, materials: Materials) -> None:
    """Grille in the brick wall's opening, bulging ones and shutters at the upper windows."""
    bars = [
        np.array([(-INSIDE - 0.15, -1.0 + dy, 0.98), (-INSIDE - 0.15, -1.0 + dy, 1.75 + (0.62**2 - dy**2) ** 0.5)])
        for dy in np.linspace(-0.54, 0.54, 10)
    ]
    bars += [np.array([(-INSIDE - 0.15, -1.63, z), (-INSIDE - 0.15, -0.37, z)]) for z in (1.2, 1.48, 1.76)]
    place(collection, "Grille bars", join(tube(bar, 0.008, 6) for bar in bars), materials["iron"], smooth=True)
    turned = [scroll(0.24)[:, [1, 0, 2]] * (1, 1 - 2 * (k % 2), 1) for k in range(9)]
    paths = [path + (-INSIDE - 0.15, -1.48 + 0.12 * k, 1.34) for k, path in enumerate(turned)]
    curve(collection, "Grille scrolls", paths, 0.005, materials["iron"])
    for x in (-3.3, 0.0, 3.3):
        _window_grille(collection, materials, x)


def _window_grille(collection: bpy.types.Collection, materials: Materials, x: float) -> None:
    z = np.linspace(5.6, 6.62, 14)
    out = np.where(z < 6.0, 0.09 + 0.13 * np.sin(np.pi * (z - 5.6) / 0.4), 0.09)
    paths = [np.stack([0 * z + x + dx, INSIDE - out, z], -1) for dx in np.linspace(-0.46, 0.46, 9)]
    paths += [np.array([(x - 0.48, INSIDE - 0.09, h), (x + 0.48, INSIDE - 0.09, h)]) for h in (5.6, 6.02, 6.3, 6.62)]
    curve(collection, "Window grille", paths, 0.008, materials["iron"])
    for side in (-1, 1):
        low, high = sorted((x + side * 0.5, x + side * 0.96))
        frame = box((low, INSIDE - 0.05, 5.6), (high, INSIDE - 0.012, 6.66))
        bevel(place(collection, "Shutter", frame, materials["door"], repeat=0.7), 0.006)
        slat = box((low + 0.05, INSIDE - 0.075, 5.68), (high - 0.05, INSIDE - 0.045, 5.70))
        array(place(collection, "Shutter slats", slat, materials["door"], repeat=0.7), 22, (0, 0, 0.042))


def build_lantern(collection: bpy.types.Collection, materials: Materials) -> None:
    """Emissive lamp: a glass body in an iron cage, hanging in the arcade's shade."""
    x, y, z = -BAY * 1.5, 4.1, PLINTH + 2.25
    glass = lathe([(0.02, 0), (0.085, 0.005), (0.12, 0.24), (0.1, 0.26), (0.02, 0.262)], 16).moved((x, y, z))
    place(collection, "Lamp", glass, materials["lamp"], smooth=True)
    bars = [
        tube(np.array([(x + 0.095 * c, y + 0.095 * s, z - 0.005), (x + 0.132 * c, y + 0.132 * s, z + 0.25)]), 0.006)
        for c, s in ((np.cos(a), np.sin(a)) for a in np.linspace(0, 2 * np.pi, 7)[:6])
    ]
    roof = lathe([(0.16, 0.25), (0.15, 0.28), (0.07, 0.34), (0.05, 0.37), (0.02, 0.4)], 16).moved((x, y, z))
    chain = tube(np.array([(x, y, z + 0.38), (x, y, 4.75)]), 0.006)
    place(collection, "Lantern", join([*bars, roof, chain]), materials["iron"])
