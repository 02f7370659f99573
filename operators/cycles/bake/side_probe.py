# SPDX-License-Identifier: GPL-3.0-or-later
"""Probe of the light on both sides of a surface at a few points, by one small bake.

Each point and side has a triangle, far smaller than a voxel and lifted off the surface like the baked mesh, and a block
of texels. The triangles are invisible to all rays.
"""

from __future__ import annotations

from contextlib import ExitStack

import bpy
import numpy as np

from ....patchnet_addon.runtime.progress import Progress, Steps
from ....patchnet_addon.surface.chroma import REC709
from ...scene_access.temporary import temporary
from ...scene_access.window_job import window_is_alive
from .bake_call import BakeTarget, bake_as_job, bake_now
from .bake_materials import aim
from .bake_scene import bake_scene, page_image, page_object, set_cycles
from .page_mesh import CHART_LAYER

SAMPLES = 64  # a texel
_BLOCK = 4  # texels of a side of a point's block
# Texels of a block whose centres its triangle covers.
_OWN = np.add.outer(np.arange(_BLOCK), np.arange(_BLOCK)) < _BLOCK - 2
_PER_ROW = 32  # blocks
_NAME = "PatchNet Probe"


def light_of_sides(
    context: bpy.types.Context,
    points_world: np.ndarray,
    normals: np.ndarray,
    lift_world: float,
    *,
    with_daylight: bool,
    at: Progress,
) -> Steps[np.ndarray]:
    """Luminance (N, 2) float32 that white matt surface would have at points (N, 3) on the side of unit normals (N, 3),
    and on the other.

    lift_world: distance off the surface. with_daylight: with our sun and sky. Reports are `at`. Raises SceneError,
    StoppedError.
    """
    yield at
    count = 2 * len(points_world)
    size = np.array([_PER_ROW, -(-count // _PER_ROW)]) * _BLOCK
    with ExitStack() as stack:
        scene, layer = stack.enter_context(bake_scene(context, with_daylight=with_daylight))
        set_cycles(scene, SAMPLES, 0, on_gpu=False)
        image = stack.enter_context(page_image(size, 1))
        mesh = stack.enter_context(temporary(bpy.data.meshes.new(_NAME)))
        _fill(mesh, points_world, normals, lift_world)
        mesh.materials.append(stack.enter_context(temporary(_white(image))))
        item = stack.enter_context(page_object(scene, mesh))
        target = BakeTarget(scene, scene.view_layers[layer], item, image)
        if window_is_alive():
            yield from bake_as_job(context, target, at)
        else:
            bake_now(context, target)
        return _means(image, count).reshape(-1, 2)


def _white(image: bpy.types.Image) -> bpy.types.Material:
    material = bpy.data.materials.new(_NAME)
    material.diffuse_color = (1.0, 1.0, 1.0, 1.0)
    aim(material, image, plain=True)
    return material


def _fill(mesh: bpy.types.Mesh, points: np.ndarray, normals: np.ndarray, lift: float) -> None:
    """Give the mesh two triangles a point, one on each side, and their places in the image."""
    both = np.stack([normals, -normals], axis=1).reshape(-1, 3)
    centers = np.repeat(points, 2, axis=0) + lift * both
    least = np.abs(both).argmin(axis=1)
    along = np.cross(both, np.eye(3)[least])
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.cross(both, along)
    corners = np.stack([centers - along, centers + along, centers + across], axis=1)
    corners = centers[:, None] + (corners - centers[:, None]) * lift
    count = len(both)
    mesh.from_pydata(corners.reshape(-1, 3).tolist(), [], np.arange(3 * count).reshape(-1, 3).tolist())
    row, column = np.divmod(np.arange(count), _PER_ROW)
    rows = -(-count // _PER_ROW)
    low = np.stack([column / _PER_ROW, row / rows], axis=1)
    side = np.array([1.0 / _PER_ROW, 1.0 / rows]) * (1.0 - 1.0 / _BLOCK)  # nothing of the next block
    places = np.stack([low, low + side * [1.0, 0.0], low + side * [0.0, 1.0]], axis=1).astype(np.float32)
    mesh.uv_layers.new(name=CHART_LAYER).data.foreach_set("uv", places.ravel())


def _means(image: bpy.types.Image, count: int) -> np.ndarray:
    """Mean luminance (count,) of the texels of each block that its triangle owns.

    Blender 5.3 also bakes texels that a triangle only touches, even of the next block.
    """
    width, height = image.size
    pixels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(pixels)
    pixels = np.nan_to_num(pixels, posinf=0.0, neginf=0.0).reshape(height // _BLOCK, _BLOCK, -1, _BLOCK, 4)
    blocks = pixels.transpose(0, 2, 1, 3, 4).reshape(-1, _BLOCK, _BLOCK, 4)[:count]
    result: np.ndarray = (blocks[:, _OWN, :3] @ REC709).mean(axis=1).astype(np.float32)
    return result
