# SPDX-License-Identifier: GPL-3.0-or-later
"""Reference of `seen_triangles`: each ray of a camera against all triangles (Moeller and Trumbore 1997)."""

from __future__ import annotations

import numpy as np

from patchnet.patchnet_addon.tracing.camera import PERSPECTIVE, Camera
from patchnet.patchnet_addon.tracing.seen_triangles import SeenTriangles


def seen_triangles_reference(camera: Camera, corners_world: np.ndarray) -> SeenTriangles:
    """Reference of `seen_triangles` for corners (N, 3, 3) float64, N > 0."""
    width, height = camera.width_px, camera.height_px
    x = (2.0 * np.arange(width) + 1.0) / width - 1.0 + camera.shift_x
    y = (2.0 * np.arange(height) + 1.0) / height - 1.0 + camera.shift_y
    across = x[None, :, None] * camera.half_x * np.asarray(camera.right)
    aside = (across + y[:, None, None] * camera.half_y * np.asarray(camera.up)).reshape(-1, 1, 3)  # (R, 1, 3)
    forward, position = np.asarray(camera.forward), np.asarray(camera.position_world)
    if camera.kind == PERSPECTIVE:  # not of unit length, so that distances are axial
        origin, toward = np.broadcast_to(position, aside.shape), forward + aside
    else:
        origin, toward = position + aside, np.broadcast_to(forward, aside.shape)
    start, one, two = corners_world[:, 0], *(corners_world[:, i] - corners_world[:, 0] for i in (1, 2))  # (N, 3)
    with np.errstate(divide="ignore", invalid="ignore"):
        p, s = np.cross(toward, two), origin - start
        scale = 1.0 / (one * p).sum(axis=-1)  # (R, N)
        q = np.cross(s, one)
        u, v = (s * p).sum(axis=-1) * scale, (toward * q).sum(axis=-1) * scale
        depth = (two * q).sum(axis=-1) * scale
        met = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (depth >= camera.clip_start) & (depth <= camera.clip_end)
    depth = np.where(met, depth, np.inf)
    nearest = depth.argmin(axis=1)
    ray = np.arange(len(depth))
    hit = np.isfinite(depth[ray, nearest])
    shape = height, width
    return SeenTriangles(np.where(hit, nearest, -1).reshape(shape), depth[ray, nearest].reshape(shape))
