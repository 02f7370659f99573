# SPDX-License-Identifier: GPL-3.0-or-later
"""Walls of the closed room at the bake's defaults: few paths a place leave them even."""

import numpy as np

from patchnet.commands.shared.scene_argument import open_or_build
from patchnet.tests.blender.light_scene import checked

BLOCK, WALL = (slice(10, 105), slice(50, 115)), (slice(100, 165), slice(215, 250))  # rows from below, columns


def mottling(picture: np.ndarray) -> float:
    """Standard deviation from the cubic surface that fits a part of a picture best, over its mean."""
    y, x = np.mgrid[-1.0 : 1.0 : 1j * picture.shape[0], -1.0 : 1.0 : 1j * picture.shape[1]]
    terms = np.stack([x**i * y**j for i in range(4) for j in range(4 - i)], axis=-1).reshape(picture.size, -1)
    values = picture.astype(np.float64).ravel()
    rest = values - terms @ np.linalg.lstsq(terms, values, rcond=None)[0]
    return float(rest.std() / values.mean())


def test_walls_look_even() -> None:
    """With 4 paths in most places. What the paths of a light cell make uneven, the filter has to even out."""
    open_or_build("room")
    settings = {"cameras": ("Front",), "size": (256, 192), "depth": 9, "color": False}
    (view,) = checked(render_samples=4, rays=16, **settings).cameras
    found = [mottling(view.octree[part]) for part in (BLOCK, WALL)]
    print(f"mottling: block {found[0]:.2%}, wall {found[1]:.2%}")
    assert max(found) < 0.015
