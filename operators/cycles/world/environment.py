# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles' bake of the environment: what camera rays see of a world where they meet nothing.

The rays are those of a camera, so that a world which shows cameras another picture than it lights with is seen as in a
render. Each texel of what is baked is a pixel of the camera: a quadrangle has the directions of the picture's corners
as its vertices, and between them directions are linear. Nothing else is in the scene that is baked, which is ours.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import bpy
import numpy as np

from ....patchnet_addon.image.cube_map import FACES, CubeMap, face_camera, view_corners
from ....patchnet_addon.runtime.errors import SceneError
from ....patchnet_addon.runtime.interrupt import interrupts_wait
from ....patchnet_addon.runtime.progress import Progress, Steps
from ....patchnet_addon.tracing.camera import ORTHOGRAPHIC, Camera
from ...scene_access.own import quiet
from ...scene_access.temporary import sync_view_layers, temporary
from ..scene_copy import looking_through

SAMPLES = 16  # a pixel of a picture
MAP_SIDE_PX, MAP_SAMPLES = 512, 2  # of a face of a cube map
_PART_PX = 1 << 21  # pixels that are baked at once
_FEW_PX = 8  # side of the picture of an orthographic camera, which sees one colour
_LAYER, _NAME = "PatchNet World", "PatchNet World"
_LARGEST = 65504.0  # float16


def world_view(world: bpy.types.World, frame: tuple[int, float], camera: Camera) -> Steps[np.ndarray]:
    """Light (P, 3) float32, linear and unexposed, that pixels of `camera` see of an original world; (3,) for one that
    is orthographic.

    frame: number and the part of it that has passed. Raises SceneError if Cycles cannot bake; in the main thread alone.
    """
    label = f"{camera.name}: World"
    if camera.kind == ORTHOGRAPHIC:
        yield Progress(0, 1, label)
        with _world_scene(world, frame, camera) as scene:
            picture = _baked(scene, view_corners(camera)[None], (_FEW_PX, _FEW_PX), SAMPLES)
        return picture.mean(axis=0)
    light = np.empty((camera.height_px, camera.width_px, 3), np.float32)
    rows = max(1, _PART_PX // camera.width_px)
    lower_left, lower_right, upper_right, upper_left = view_corners(camera)
    for row in range(0, camera.height_px, rows):
        yield Progress(row, camera.height_px, label)
        last = min(row + rows, camera.height_px)
        low, high = row / camera.height_px, last / camera.height_px
        left, right = upper_left - lower_left, upper_right - lower_right
        corners = [lower_left + low * left, lower_right + low * right, lower_right + high * right,
                   lower_left + high * left]  # fmt: skip
        with _world_scene(world, frame, camera) as scene:
            part = _baked(scene, np.array(corners)[None], (camera.width_px, last - row), SAMPLES)
        light[row:last] = part.reshape(last - row, camera.width_px, 3)
    return light.reshape(-1, 3)


def world_map(world: bpy.types.World, frame: tuple[int, float]) -> CubeMap:
    """Light of an original world in all directions; raises SceneError if Cycles cannot bake; in the main thread."""
    side = MAP_SIDE_PX
    corners = np.array([view_corners(face_camera(face, side)) for face in range(len(FACES))])
    with _world_scene(world, frame, face_camera(0, side)) as scene:
        light = _baked(scene, corners, (side, side), MAP_SAMPLES)  # all at once: Cycles reads the world once
    return CubeMap(np.clip(light, -_LARGEST, _LARGEST).astype(np.float16).reshape(len(FACES), side, side, 3))


@contextmanager
def _world_scene(world: bpy.types.World, frame: tuple[int, float], camera: Camera) -> Iterator[bpy.types.Scene]:
    """Scene of ours with nothing but a world, and a camera for worlds that ask for places in its picture."""
    with quiet():
        with temporary(bpy.data.scenes.new(_NAME)) as scene:
            if not hasattr(scene, "cycles"):
                raise SceneError("The Cycles render engine is disabled: enable its add-on to see the world")
            scene.world = world
            scene.frame_current = frame[0]
            scene.frame_subframe = frame[1]
            scene.render.engine = "CYCLES"
            scene.render.resolution_x, scene.render.resolution_y = camera.width_px, camera.height_px
            cycles = {"use_adaptive_sampling": False, "use_denoising": False, "film_exposure": 1.0, "time_limit": 0.0}
            for name, value in cycles.items():
                setattr(scene.cycles, name, value)
            with looking_through(scene, camera):
                yield scene
        sync_view_layers()


def _baked(scene: bpy.types.Scene, corners: np.ndarray, size: tuple[int, int], samples: int) -> np.ndarray:
    """Light (Q * width * height, 3) float32 of pictures one above the other, of directions between the four corners of
    each, (Q, 4, 3): lower left, right, upper right, left."""
    width, height, count = size[0], len(corners) * size[1], len(corners)
    scene.cycles.samples = samples
    with ExitStack() as stack:
        image = bpy.data.images.new(_NAME, width, height, alpha=True, float_buffer=True, is_data=True)
        stack.enter_context(temporary(image))
        material = stack.enter_context(temporary(bpy.data.materials.new(_NAME)))
        if bpy.app.version < (5, 0, 0):
            material.use_nodes = True
        node = material.node_tree.nodes.new("ShaderNodeTexImage")
        node.image = image
        material.node_tree.nodes.active = node
        mesh = stack.enter_context(temporary(bpy.data.meshes.new(_NAME)))
        halves = [(4 * each, 4 * each + b, 4 * each + c) for each in range(count) for b, c in ((1, 2), (2, 3))]
        mesh.from_pydata(corners.reshape(-1, 3).tolist(), [], halves)
        places = np.tile(np.array([[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]], np.float32), (count, 1, 1))
        places[..., 1] = (places[..., 1] + np.arange(count)[:, None]) / count
        mesh.uv_layers.new(name=_LAYER).data.foreach_set("uv", places.ravel())
        mesh.materials.append(material)
        item = stack.enter_context(temporary(bpy.data.objects.new(_NAME, mesh)))
        scene.collection.objects.link(item)
        sync_view_layers()
        _bake(scene, item)
        pixels = np.empty(width * height * 4, np.float32)
        image.pixels.foreach_get(pixels)
    return np.nan_to_num(pixels.reshape(-1, 4)[:, :3], posinf=0.0, neginf=0.0)


def _bake(scene: bpy.types.Scene, item: bpy.types.Object) -> None:
    override = {"scene": scene, "view_layer": scene.view_layers[0]}
    override |= {"active_object": item, "object": item, "selected_objects": [item]}
    how = {"margin": 0, "use_clear": True, "target": "IMAGE_TEXTURES", "save_mode": "INTERNAL", "uv_layer": _LAYER}
    try:
        with interrupts_wait(), bpy.context.temp_override(**override):
            bpy.ops.object.bake(type="ENVIRONMENT", use_selected_to_active=False, **how)
    except RuntimeError as cause:
        reason = str(cause).strip().removeprefix("Error: ")
        raise SceneError(f"Cycles cannot bake the world ({reason})") from cause
