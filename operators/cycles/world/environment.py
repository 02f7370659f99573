# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles' bake of the environment: what camera rays see of a world where they meet nothing.

The rays are those of a camera, so that a world which shows cameras another picture than it lights with is seen as in a
render. Each texel of what is baked is a pixel of the camera: a quadrangle has the directions of the picture's corners
as its vertices, and between them directions are linear. Nothing else is in the scene that is baked, which is ours.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import NamedTuple

import bpy
import numpy as np

from ....patchnet_addon.image.cube_map import FACES, CubeMap, face_camera, view_corners
from ....patchnet_addon.runtime.errors import SceneError
from ....patchnet_addon.runtime.progress import Progress, Steps
from ....patchnet_addon.tracing.camera import ORTHOGRAPHIC, Camera
from ...scene_access.own import quiet
from ...scene_access.temporary import sync_view_layers, temporary
from ...scene_access.window_job import when_job_ended, window_is_alive
from ..bake.bake_call import WORLD, BakeTarget, bake_as_job, bake_now
from ..bake.bake_scene import cycles_settings, page_image, page_mesh
from ..bake.page_mesh import CHART_LAYER
from ..scene_copy import looking_through

SAMPLES = 16  # a pixel of a picture
MAP_SIDE_PX, MAP_SAMPLES = 512, 2  # of a face of a cube map
_PART_PX = 1 << 21  # pixels that are baked at once
_FEW_PX = 8  # side of the picture of an orthographic camera, which sees one colour
_NAME = "PatchNet World"
_LARGEST = 65504.0  # float16


def world_view(world: bpy.types.World, frame: tuple[int, float], camera: Camera) -> Steps[np.ndarray]:
    """Light (P, 3) float32, linear and unexposed, that pixels of `camera` see of an original world; (3,) for one that
    is orthographic.

    frame: number and the part of it that has passed. Raises SceneError if Cycles cannot bake, StoppedError after Esc;
    in the main thread alone.
    """
    label = f"{camera.name}: World"
    seen = _Seen(world, frame, camera, SAMPLES)
    if camera.kind == ORTHOGRAPHIC:
        size = (_FEW_PX, _FEW_PX)
        picture = yield from _baked(seen, view_corners(camera)[None], size, Progress(0, 1, label))
        return picture.mean(axis=0)
    light = np.empty((camera.height_px, camera.width_px, 3), np.float32)
    rows = max(1, _PART_PX // camera.width_px)
    lower_left, lower_right, upper_right, upper_left = view_corners(camera)
    for row in range(0, camera.height_px, rows):
        last = min(row + rows, camera.height_px)
        low, high = row / camera.height_px, last / camera.height_px
        left, right = upper_left - lower_left, upper_right - lower_right
        corners = [lower_left + low * left, lower_right + low * right, lower_right + high * right,
                   lower_left + high * left]  # fmt: skip
        at = Progress(row, camera.height_px, label)
        part = yield from _baked(seen, np.array(corners)[None], (camera.width_px, last - row), at)
        light[row:last] = part.reshape(last - row, camera.width_px, 3)
    return light.reshape(-1, 3)


def world_map(world: bpy.types.World, frame: tuple[int, float]) -> Steps[CubeMap]:
    """Light of an original world in all directions; as `world_view` otherwise."""
    side = MAP_SIDE_PX
    corners = np.array([view_corners(face_camera(face, side)) for face in range(len(FACES))])
    seen = _Seen(world, frame, face_camera(0, side), MAP_SAMPLES)
    light = yield from _baked(seen, corners, (side, side), Progress(0, 1, "World"))  # Cycles reads the world once
    return CubeMap(np.clip(light, -_LARGEST, _LARGEST).astype(np.float16).reshape(len(FACES), side, side, 3))


class _Seen(NamedTuple):
    """World at a frame, a camera for worlds that ask for places in its picture, and samples for each pixel."""

    world: bpy.types.World
    frame: tuple[int, float]
    camera: Camera
    samples: int


def _baked(seen: _Seen, corners: np.ndarray, size: tuple[int, int], at: Progress) -> Steps[np.ndarray]:
    """Light (Q * width * height, 3) float32 of pictures one above the other, of directions between the four corners of
    each, (Q, 4, 3): lower left, right, upper right, left.

    Reports are `at`. In a window what is baked stays there while steps wait.
    """
    yield at  # what is baked is set up after it: between two steps nothing of ours is there
    width, height = size[0], len(corners) * size[1]
    stack = ExitStack()
    try:
        if not window_is_alive():
            stack.enter_context(quiet())  # who waits beside a window is quiet for each step
        stack.callback(sync_view_layers)
        scene = stack.enter_context(_world_scene(seen))
        image = stack.enter_context(page_image(np.array([width, height]), 1))
        item = stack.enter_context(_directions(scene, image, corners))
        target = BakeTarget(scene, scene.view_layers[0], item, image, what=WORLD)
        if window_is_alive():
            yield from bake_as_job(bpy.context, target, at)
        else:
            bake_now(bpy.context, target)
        pixels = np.empty(width * height * 4, np.float32)
        image.pixels.foreach_get(pixels)
        return np.nan_to_num(pixels.reshape(-1, 4)[:, :3], posinf=0.0, neginf=0.0)
    finally:
        when_job_ended(stack.close)


@contextmanager
def _world_scene(seen: _Seen) -> Iterator[bpy.types.Scene]:
    """Scene of ours with nothing but a world and a camera."""
    camera = seen.camera
    with temporary(bpy.data.scenes.new(_NAME)) as scene:
        if not hasattr(scene, "cycles"):
            raise SceneError("The Cycles render engine is disabled: enable its add-on to see the world")
        scene.world = seen.world
        scene.frame_current, scene.frame_subframe = seen.frame
        scene.render.resolution_x, scene.render.resolution_y = camera.width_px, camera.height_px
        with cycles_settings(scene, seen.samples, 0, on_gpu=False), looking_through(scene, camera):
            yield scene


@contextmanager
def _directions(scene: bpy.types.Scene, image: bpy.types.Image, corners: np.ndarray) -> Iterator[bpy.types.Object]:
    """Object with quadrangles (Q, 4, 3) whose points are directions, one above the other on an image."""
    count = len(corners)
    with (
        temporary(bpy.data.materials.new(_NAME)) as material,
        page_mesh() as mesh,
        temporary(bpy.data.objects.new(_NAME, mesh)) as item,
    ):
        if bpy.app.version < (5, 0, 0):
            material.use_nodes = True
        node = material.node_tree.nodes.new("ShaderNodeTexImage")
        node.image = image
        material.node_tree.nodes.active = node
        halves = [(4 * each, 4 * each + b, 4 * each + c) for each in range(count) for b, c in ((1, 2), (2, 3))]
        mesh.from_pydata(corners.reshape(-1, 3).tolist(), [], halves)
        places = np.tile(np.array([[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]], np.float32), (count, 1, 1))
        places[..., 1] = (places[..., 1] + np.arange(count)[:, None]) / count
        mesh.uv_layers.new(name=CHART_LAYER).data.foreach_set("uv", places.ravel())
        mesh.materials.append(material)
        scene.collection.objects.link(item)
        sync_view_layers()
        yield item
