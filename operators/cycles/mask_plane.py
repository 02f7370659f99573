# SPDX-License-Identifier: GPL-3.0-or-later
"""Holdout before a camera, with holes where pixels are wanted, that limits a Cycles render to any set of pixels.

A pixel behind the holdout costs one ray. Rays through a hole meet nothing of it, so that these pixels get the samples
of a whole render. Only camera rays meet the holdout: it changes no light and no shadow.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import bpy
import numpy as np

from ...patchnet_addon.tracing.camera import PERSPECTIVE, Camera
from ..scene_access.polygons import add_polygons
from ..scene_access.temporary import temporary

_ONLY_CAMERA = (
    "visible_diffuse", "visible_glossy", "visible_transmission", "visible_volume_scatter", "visible_shadow",
)  # fmt: skip
_BEYOND_CLIP = 1.01  # of the clip start
_GAP_PX, _GAP_STEPS = 1e-3, 4.0  # around holes, at least: of a pixel, and steps of float32 there


@contextmanager
def mask_plane(scene: bpy.types.Scene, camera: Camera, mask: np.ndarray, depth_world: float) -> Iterator[None]:
    """Put the holdout into a scene copy within the block, before all pixels that are not in `mask`.

    mask: (H, W) bool, row 0 at the bottom. depth_world: of the nearest surface. The holdout stands halfway to it: much
    nearer, float32 would not resolve its pixels in a large scene.
    """
    depth_world = max(camera.clip_start * _BEYOND_CLIP, min(depth_world, camera.clip_end) / 2.0)
    with ExitStack() as stack:
        mesh = stack.enter_context(temporary(bpy.data.meshes.new("PatchNet Mask")))
        add_polygons(mesh, _corners(camera, mask, depth_world))
        mesh.update(calc_edges=True)
        item = stack.enter_context(temporary(bpy.data.objects.new("PatchNet Mask", mesh)))
        item.location, item.is_holdout = camera.position_world, True
        for name in _ONLY_CAMERA:
            setattr(item, name, False)
        scene.collection.objects.link(item)
        yield


def _corners(camera: Camera, mask: np.ndarray, depth_world: float) -> np.ndarray:
    """(N, 4, 3) float64: a rectangle for each run of pixels without `mask` in a row, from the camera's position.

    They are slightly smaller than their pixels, so that no rounding lets them cut off a part of a hole.
    """
    height, width = mask.shape
    spread = depth_world if camera.kind == PERSPECTIVE else 1.0
    across, up = np.asarray(camera.right) * camera.half_x * spread, np.asarray(camera.up) * camera.half_y * spread
    pixel_world = 2.0 * spread * min(camera.half_x / width, camera.half_y / height)
    step_world = np.spacing(np.float32(np.abs(camera.position_world).max() + depth_world))
    gap = max(_GAP_PX, _GAP_STEPS * float(step_world) / pixel_world)
    changes = np.diff(np.pad(mask, ((0, 0), (1, 1)), constant_values=True).astype(np.int8))
    (row, first), (_, end) = np.nonzero(changes < 0), np.nonzero(changes > 0)
    left, right, low, high = first + gap, end - gap, row + gap, row + 1.0 - gap
    there = (left < right) & (low < high)
    x = np.stack([left, right, right, left], axis=1)[there] / width * 2.0 - 1.0 + camera.shift_x
    y = np.stack([low, low, high, high], axis=1)[there] / height * 2.0 - 1.0 + camera.shift_y
    result: np.ndarray = np.asarray(camera.forward) * depth_world + x[..., None] * across + y[..., None] * up
    return result
