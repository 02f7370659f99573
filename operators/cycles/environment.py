# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles bake of the environment, as camera rays see a world.

Camera rays matter where a world shows cameras another picture than it lights with. Each baked texel is a pixel of the
camera: the vertices of a quad are the directions of the picture's corners, and directions are linear between them. The
baked scene is a temporary one that holds nothing else.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import bpy
import numpy as np

from ...patchnet_addon.image.cube_map import FACES, CubeMap, face_camera, view_corners
from ...patchnet_addon.runtime.errors import SceneError
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.tracing.camera import ORTHOGRAPHIC, Camera
from ..scene_access.blender_version import start_nodes
from ..scene_access.own import quiet
from ..scene_access.temporary import sync_view_layers, temporary
from ..scene_access.window_job import editors_keep_images, window_is_alive
from .scene_copy import looking_through

SAMPLES = 16  # a pixel of a picture
MAP_SIDE_PX, MAP_SAMPLES = 512, 2  # of a face of a cube map
_PART_PX = 1 << 21  # pixels that are baked at once without a window
# Paths that are baked at once in a window, which freezes meanwhile. Such a bake cannot run as a job of Blender's,
# as those of pages do: Blender frees the job's image at the next event if the window shows another scene.
_PATHS_IN_WINDOW = 1 << 19
_FEW_PX = 8  # side of the picture of an orthographic camera, which sees one colour
_LAYER, _NAME = "PatchNet World", "PatchNet World"
_LARGEST = 65504.0  # float16


def world_view(world: bpy.types.World, frame: tuple[int, float], camera: Camera, samples: int) -> Steps[np.ndarray]:
    """Light (P, 3) float32, linear and unexposed, that pixels of `camera` see of an original world; (3,) for one that
    is orthographic.

    frame: frame and subframe. Main thread only. Raises SceneError if Cycles cannot bake.
    """
    label = f"{camera.name}: World"
    if camera.kind == ORTHOGRAPHIC:
        yield Progress(0, 1, label)
        with _world_scene(world, frame, camera) as scene:
            picture = _baked(scene, view_corners(camera), (_FEW_PX, _FEW_PX), samples)
        return picture.mean(axis=0)
    light = np.empty((camera.height_px, camera.width_px, 3), np.float32)
    rows = max(1, (_PATHS_IN_WINDOW // samples if window_is_alive() else _PART_PX) // camera.width_px)
    for row in range(0, camera.height_px, rows):
        yield Progress(row, camera.height_px, label)
        last = min(row + rows, camera.height_px)
        with _world_scene(world, frame, camera) as scene:
            corners = _rows_of(view_corners(camera), row, last, camera.height_px)
            part = _baked(scene, corners, (camera.width_px, last - row), samples)
        light[row:last] = part.reshape(last - row, camera.width_px, 3)
    return light.reshape(-1, 3)


def world_map(world: bpy.types.World, frame: tuple[int, float]) -> Steps[CubeMap]:
    """Light of an original world in all directions; main thread only; raises SceneError if Cycles cannot bake."""
    faces = np.empty((len(FACES), MAP_SIDE_PX, MAP_SIDE_PX, 3), np.float16)
    for face in range(len(FACES)):
        light = yield from world_view(world, frame, face_camera(face, MAP_SIDE_PX), MAP_SAMPLES)
        faces[face] = np.clip(light, -_LARGEST, _LARGEST).reshape(MAP_SIDE_PX, MAP_SIDE_PX, 3)
    return CubeMap(faces)


def _rows_of(corners: np.ndarray, first: int, last: int, height: int) -> np.ndarray:
    """Corners (4, 3) of some rows of a picture with the `corners` (4, 3): lower left, right, upper right, left."""
    lower_left, lower_right, upper_right, upper_left = corners
    left, right = (upper_left - lower_left) / height, (upper_right - lower_right) / height
    return np.stack([lower_left + first * left, lower_right + first * right, lower_right + last * right,
                     lower_left + last * left])  # fmt: skip


@contextmanager
def _world_scene(world: bpy.types.World, frame: tuple[int, float], camera: Camera) -> Iterator[bpy.types.Scene]:
    """Temporary scene with a world, and a camera for worlds that read window coordinates."""
    with quiet():
        with temporary(bpy.data.scenes.new(_NAME)) as scene, ExitStack() as stack:
            if not hasattr(scene, "cycles"):
                raise SceneError("The Cycles render engine is disabled: enable its add-on to see the world")
            scene.world = stack.enter_context(temporary(world.copy()))
            scene.world.cycles.sampling_method = "NONE"  # skips preparing an importance map, which takes seconds
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
    """Light (width * height, 3) float32 of a picture of directions between four corners (4, 3): lower left, right,
    upper right, left."""
    width, height = size
    scene.cycles.samples = samples
    with ExitStack() as stack:
        image = bpy.data.images.new(_NAME, width, height, alpha=True, float_buffer=True, is_data=True)
        stack.enter_context(temporary(image))
        material = stack.enter_context(temporary(bpy.data.materials.new(_NAME)))
        nodes = start_nodes(material).nodes
        nodes.active = nodes.new("ShaderNodeTexImage")
        nodes.active.image = image
        mesh = stack.enter_context(temporary(bpy.data.meshes.new(_NAME)))
        mesh.from_pydata(corners.tolist(), [], [(0, 1, 2), (0, 2, 3)])
        places = np.array([[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]], np.float32)
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
        keeping = editors_keep_images(bpy.context.window_manager)
        with keeping, bpy.context.temp_override(**override):
            bpy.ops.object.bake(type="ENVIRONMENT", use_selected_to_active=False, **how)
    except RuntimeError as cause:
        reason = str(cause).strip().removeprefix("Error: ")
        raise SceneError(f"Cycles cannot bake the world ({reason})") from cause
