# SPDX-License-Identifier: GPL-3.0-or-later
"""Held-out scene made by code: a yard of fences, a cloth over a table and rotated boxes, with structure as fine as the
voxels in which rays stop.
"""

import numpy as np
from numpy.typing import ArrayLike

from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.patchnet_addon.octree.voxelize import LeafDetail
from patchnet.patchnet_addon.surface.mesh import Material, TriangleMesh
from patchnet.patchnet_addon.surface.shading import two_lights_shade
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.tests.engine.mesh_samples import box, in_batches, octree_of

DEPTH = 9
_GRAYS = (0.08, 0.2, 0.35, 0.5, 0.65, 0.8, 0.95)
_DARK, _BRIGHT = 0, len(_GRAYS) - 1

Box = tuple[np.ndarray, int]
"""Triangles (12, 3, 3) in world units, and the index of their gray in `_GRAYS`."""


def yard_octree() -> Octree:
    """Octree of the yard in about a unit cube, lit by two lights; deterministic."""
    boxes = [_box((0.5, 0.5, 0.005), (1.0, 1.0, 0.01), 3), *_fences(), *_table(), *_scattered_boxes()]
    corners = np.concatenate([triangles for triangles, _ in boxes])
    materials = np.repeat(np.array([gray for _, gray in boxes], np.int32), len(boxes[0][0]))
    grays = tuple(Material(f"gray {gray}", (gray,) * 3) for gray in _GRAYS)
    mesh = TriangleMesh(in_batches(corners, (), materials=materials), grays)
    made, detail = {"scene": "yard"}, LeafDetail(boxes=True)
    return octree_of(mesh, two_lights_shade(mesh), DEPTH, exposure=1.0, provenance=made, detail=detail)


def yard_cameras() -> list[Camera]:
    """Cameras around the yard, so far away that nearly all hits have look-ahead."""
    places = ((1.35, -0.35, 0.75), (-0.5, 0.15, 0.45), (0.4, 1.75, 0.6), (1.9, 1.2, 1.3))
    target = np.array([0.5, 0.5, 0.15])
    return [Camera.look_at(np.array(place), target, size_px=(96, 72)) for place in places]


def _fences() -> list[Box]:
    """Fences of upright slats along three sides, whose gaps are about as wide as voxels."""
    long = [
        _box((along, across, 0.15), (0.006, 0.003, 0.30), 5)
        for along in np.arange(0.06, 0.94, 0.013)
        for across in (0.05, 0.95)
    ]
    short = [_box((0.95, along, 0.11), (0.004, 0.014, 0.22), 4) for along in np.arange(0.06, 0.94, 0.024)]
    return long + short


def _table() -> list[Box]:
    """Dark table under a bright cloth that hangs over its edges at a distance of a few leaves."""
    top = [_box((0.42, 0.45, 0.2), (0.36, 0.26, 0.01), _DARK)]
    legs = [_box((x, y, 0.1), (0.012, 0.012, 0.2), _DARK) for x in (0.26, 0.58) for y in (0.34, 0.56)]
    # Bands, so that the table is visible between them.
    cloth = [_box((x, 0.45, 0.215), (0.017, 0.3, 0.002), _BRIGHT) for x in np.arange(0.25, 0.6, 0.024)]
    hem = [_box((0.42, y, 0.18), (0.4, 0.002, 0.07), _BRIGHT) for y in (0.3, 0.6)]
    return top + legs + cloth + hem


def _scattered_boxes(count: int = 260) -> list[Box]:
    """Small boxes on the ground and in the air, with random rotations and grays."""
    random = np.random.default_rng(41)
    boxes = []
    for _ in range(count):
        place = np.append(random.uniform(0.1, 0.9, 2), 0.02 + 0.5 * random.random() ** 3)
        size = random.uniform(0.004, 0.05, 3)
        turn, _ = np.linalg.qr(random.normal(size=(3, 3)))
        boxes.append(_box(place, size, int(random.integers(len(_GRAYS))), turn))
    return boxes


def _box(place_world: ArrayLike, size_world: ArrayLike, gray: int, turn: np.ndarray | None = None) -> Box:
    half = np.asarray(size_world) / 2
    return box(-half, half) @ (np.eye(3) if turn is None else turn) + np.asarray(place_world), gray
