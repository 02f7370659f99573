# SPDX-License-Identifier: GPL-3.0-or-later
"""Plain references of pieces and of triangles that cameras see: every ray against every triangle; packed light."""

from __future__ import annotations

import numpy as np

from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.pieces import EXPONENT_BIAS, MANTISSA
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.patchnet_addon.tracing.seen_triangles import SeenTriangles
from patchnet.tests.references.first_hits import picture_points, pixel_rays


def nearest_triangles(
    corners: np.ndarray, origin: np.ndarray, direction: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Nearest of triangles (T, 3, 3) that rays (N, 3) meet, -1 for none (N,), length (N,), weights of its last two
    corners (N, 2), and whether its front is met (N,).
    """
    count = len(origin)
    nearest, length = np.full(count, -1), np.full(count, np.inf)
    weights, front = np.zeros((count, 2)), np.zeros(count, bool)
    for number, (one, two, three) in enumerate(corners):
        normal = np.cross(two - one, three - one)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = ((one - origin) @ normal) / (direction @ normal)
        place = origin + t[:, None] * direction - one
        edges = np.stack([two - one, three - one])
        solved = np.linalg.solve(edges @ edges.T, edges @ place.T).T
        met = (solved >= 0.0).all(axis=1) & (solved.sum(axis=1) <= 1.0) & (t > 0.0) & (t < length)
        nearest[met], length[met], weights[met] = number, t[met], solved[met]
        front[met] = (direction[met] @ normal) < 0.0
    return nearest, length, weights, front


def seen_triangles_reference(camera: Camera, corners_world: np.ndarray) -> SeenTriangles:
    """Reference of `seen_triangles` for corners (N, 3, 3) float64."""
    origin, direction, speed = pixel_rays(Grid((0.0, 0.0, 0.0), 1.0, 1), camera, *picture_points(camera))
    begin = origin + (camera.clip_start / speed)[:, None] * direction
    nearest, length, *_ = nearest_triangles(corners_world, begin, direction)
    depth, shape = camera.clip_start + length * speed, (camera.height_px, camera.width_px)
    seen = depth <= camera.clip_end
    return SeenTriangles(np.where(seen, nearest, -1).reshape(shape), np.where(seen, depth, np.inf).reshape(shape))


def unpacked_light(packed: np.ndarray) -> np.ndarray:
    """Colours (..., 3) float32 of packed ones (...)."""
    packed = np.asarray(packed, np.uint32)
    scale = np.exp2((packed >> 27).astype(np.float32) - EXPONENT_BIAS) / np.float32(MANTISSA)
    steps = np.stack([packed & 511, packed >> 9 & 511, packed >> 18 & 511], axis=-1)
    return np.asarray(steps * scale[..., None], np.float32)
