# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras for the tracer: from Blender cameras, from numbers, and three around a scene without cameras."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import bpy
import numpy as np

from ...patchnet_addon.lod.placed_cameras import cameras_inside
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.process.computed import computed
from ...patchnet_addon.runtime.errors import SceneError
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.runtime.quantities import named_list
from ...patchnet_addon.surface.mesh import MeshSource
from ...patchnet_addon.tracing.camera import FRAMING_DIRECTION, ORTHOGRAPHIC, PERSPECTIVE, Camera
from ..scene_access.frames import kept_values
from ..scene_access.temporary import sync_view_layers, temporary

ALL = "all"
AUTO = "auto"
# Distance of the framing cameras in units of the distance at which the scene's bounding sphere fills the picture.
_AUTO_DISTANCES = {"Far": 2.2, "Middle": 1.0, "Close": 0.45}
_AUTO_FOV = np.radians(50.0)
_AUTO_INSIDE = ("View 1", "View 2", "View 3")  # names as in `viewpoints`


def camera_size_px(scene: bpy.types.Scene, size: tuple[int, int] = (0, 0)) -> tuple[int, int]:
    """Width and height of pictures: `size`, where a 0 follows the render aspect; (0, 0) is the render resolution."""
    render = scene.render
    percent = render.resolution_percentage  # in integers, as in Blender: 100 pixels at 29 % are 29
    full = max(1, render.resolution_x * percent // 100), max(1, render.resolution_y * percent // 100)
    if not any(size):
        return full
    width, height = size
    return width or max(1, round(height * full[0] / full[1])), height or max(1, round(width * full[1] / full[0]))


def tracing_camera(camera: bpy.types.Object, scene: bpy.types.Scene, size: tuple[int, int] = (0, 0)) -> Camera:
    """View that Blender renders through an evaluated camera object, at a size as in `camera_size_px`.

    Sensor fit, shift, pixel aspect and clipping follow Blender. Only the sign of the object's scale matters.
    Raises SceneError for panoramic cameras and for objects that are no cameras.
    """
    data = camera.data
    if not isinstance(data, bpy.types.Camera):
        raise SceneError(f"Object '{camera.name}' is not a camera: choose a camera object")
    if data.type not in (PERSPECTIVE, ORTHOGRAPHIC):
        raise SceneError(
            f"Camera '{camera.name}' is of type {data.type.lower()}: choose a perspective or orthographic camera"
        )
    width, height = camera_size_px(scene, size)
    half_x, half_y, shift_x, shift_y = _lens(
        data, width * scene.render.pixel_aspect_x, height * scene.render.pixel_aspect_y
    )
    right, up, back = _axes(np.array(camera.matrix_world, np.float64), camera.name)
    return Camera(
        position_world=np.array(camera.matrix_world.translation, np.float64),
        right=right,
        up=up,
        forward=-back,
        half_x=half_x,
        half_y=half_y,
        width_px=width,
        height_px=height,
        kind=data.type,
        shift_x=shift_x,
        shift_y=shift_y,
        name=camera.name,
        clip_start=float(data.clip_start),
        clip_end=float(data.clip_end),
    )


def _lens(data: bpy.types.Camera, width: float, height: float) -> tuple[float, float, float, float]:
    """Half extents of the picture and its shift in them: tangents for perspective, lengths for orthographic cameras.

    Blender fits the sensor (or the orthographic scale) to one side of the picture, which is also the unit of shift.
    """
    horizontal = data.sensor_fit == "HORIZONTAL" or (data.sensor_fit == "AUTO" and width >= height)
    if data.type == ORTHOGRAPHIC:
        half = data.ortho_scale / 2.0
    else:
        sensor = data.sensor_height if data.sensor_fit == "VERTICAL" else data.sensor_width
        half = sensor / (2.0 * data.lens)
    unit = half / (width if horizontal else height)
    half_x, half_y = unit * width, unit * height
    return half_x, half_y, 2.0 * data.shift_x * half / half_x, 2.0 * data.shift_y * half / half_y


def _axes(matrix_world: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Right, up and back (3,) of a camera, orthonormal whatever the scale of the object and its parents.

    A scale that mirrors the object mirrors the picture: right then points to the other side.
    """
    back = matrix_world[:3, 2]
    up = matrix_world[:3, 1]
    right = np.cross(up, back)
    if not (np.isfinite(matrix_world).all() and np.linalg.norm(right) > 0):
        raise SceneError(f"Camera '{name}' has no direction: its scale is zero or its transform is not finite")
    back = back / np.linalg.norm(back)
    right = right / np.linalg.norm(right)
    up = np.cross(back, right)
    return (-right if right @ matrix_world[:3, 0] < 0 else right), up, back


def framing_cameras(bounds_world: np.ndarray, size: tuple[int, int]) -> list[Camera]:
    """Cameras Far, Middle and Close that look at a box (2, 3); the scene stays unchanged."""
    low, high = np.asarray(bounds_world, np.float64)
    centre, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    direction = FRAMING_DIRECTION / np.linalg.norm(FRAMING_DIRECTION)
    aspect = size[0] / size[1]
    half_angle = np.arctan(np.tan(_AUTO_FOV / 2) * min(aspect, 1.0))
    distance = radius / np.sin(half_angle)
    return [
        Camera.look_at(centre + direction * distance * factor, centre, fov=_AUTO_FOV, size_px=size, name=name)
        for name, factor in _AUTO_DISTANCES.items()
    ]


def numbered_camera(text: str, size: tuple[int, int]) -> Camera | None:
    """Camera given as "X Y Z > X Y Z", position and target, or "... @ DEGREES" high; None for other text.

    Raises SceneError for invalid numbers.
    """
    places, _, degrees = text.partition("@")
    try:
        position, target = (np.array([float(word) for word in part.split()]) for part in places.split(">"))
        fov = float(degrees) if degrees.strip() else np.degrees(_AUTO_FOV)
    except ValueError:
        return None
    values = np.array([*position, *target, fov])
    if len(position) != 3 or len(target) != 3 or not np.isfinite(values).all() or not 0.0 < fov < 180.0:
        raise SceneError(f"'{text}' is not a view: write X Y Z > X Y Z, and after @ an angle between 0 and 180 degrees")
    if (position == target).all():
        raise SceneError(f"The view '{text}' has its target at its position: give another target")
    return Camera.look_at(position, target, fov=np.radians(fov), size_px=size, name=text)


def camera_names(scene: bpy.types.Scene, names: Sequence[str]) -> list[str]:
    """Possible names of cameras of `looking_cameras`; raises SceneError for a camera that does not exist."""
    if list(names) == [AUTO]:
        return [*_AUTO_DISTANCES, *_AUTO_INSIDE]
    known = scene_cameras(scene)
    if list(names) == [ALL]:
        chosen = sorted(known)
    elif names:  # the list was split at commas, which a camera's name may contain
        whole = next((text for text in (", ".join(names), ",".join(names)) if text in known), None)
        chosen = [whole] if whole else list(dict.fromkeys(names))
    else:
        active = camera_name(scene, scene.camera)
        chosen = [active] if active else []
    if not chosen:
        raise SceneError("The scene has no camera: add one, or use the cameras 'auto', or give one as X Y Z > X Y Z")
    for name in chosen:
        if name not in known and numbered_camera(name, (1, 1)) is None:
            there = ", ".join(f"'{camera}'" for camera in sorted(known)) or "none"
            raise SceneError(f"There is no camera '{name}' in scene '{scene.name}': its cameras are {there}")
    return chosen


def scene_cameras(scene: bpy.types.Scene) -> dict[str, bpy.types.Object]:
    """Scene's camera objects by name, and its active one, which another scene may hold.

    Linked cameras that share a name have their file after it: Cam [set.blend].
    """
    cameras = [item for item in scene.objects if item.type == "CAMERA"]
    if scene.camera is not None and scene.camera.type == "CAMERA" and scene.camera not in cameras:
        cameras.append(scene.camera)
    count = Counter(item.name for item in cameras)
    return {item.name_full if item.library and count[item.name] > 1 else item.name: item for item in cameras}


def camera_name(scene: bpy.types.Scene, camera: bpy.types.Object | None) -> str:
    """Name of a camera among `scene_cameras`, "" for none of them."""
    return next((name for name, item in scene_cameras(scene).items() if item == camera), "")


def looking_cameras(
    depsgraph: bpy.types.Depsgraph,
    names: Sequence[str],
    size: tuple[int, int],
    bounds_world: np.ndarray,
    surface: MeshSource | Octree,
) -> Steps[list[Camera]]:
    """Cameras of `choose_cameras`, but `auto` places them inside an enclosing surface, such as a room.

    surface: in view, or its octree. Raises SceneError for a camera that does not exist.
    """
    placed: list[Camera] = []
    if list(names) == [AUTO]:
        wanted = surface, bounds_world, len(_AUTO_INSIDE), camera_size_px(depsgraph.scene, size)
        placed = yield from computed(cameras_inside, *wanted, at=Progress(0, 1, "Placing cameras"))
    return placed or choose_cameras(depsgraph, names, size, bounds_world)


def octree_cameras(
    context: bpy.types.Context, octree: Octree, names: Sequence[str], size: tuple[int, int]
) -> Steps[list[Camera]]:
    """Cameras of `looking_cameras` around an octree."""
    bounds_world = octree.grid.to_world(np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]))
    depsgraph = context.evaluated_depsgraph_get()
    return (yield from looking_cameras(depsgraph, names, size, bounds_world, octree))


def choose_cameras(
    depsgraph: bpy.types.Depsgraph,
    names: Sequence[str],
    size: tuple[int, int],
    bounds_world: np.ndarray,
) -> list[Camera]:
    """Cameras by name or numbers: `all` of the scene, `auto` around the bounds; without names, the active camera.

    Raises SceneError for a camera that does not exist.
    """
    scene = depsgraph.scene
    chosen = camera_names(scene, names)
    if list(names) == [AUTO]:
        return framing_cameras(bounds_world, camera_size_px(scene, size))
    cameras = scene_cameras(scene)
    size_px = camera_size_px(scene, size)
    numbered = {name: numbered_camera(name, size_px) for name in chosen if name not in cameras}
    return [numbered.get(name) or replace(_view(cameras[name], depsgraph, size), name=name) for name in chosen]


def _view(camera: bpy.types.Object, depsgraph: bpy.types.Depsgraph, size: tuple[int, int]) -> Camera:
    """View of a camera of the scene, with parents and constraints, also of one outside the view layer."""
    evaluated, scene = camera.evaluated_get(depsgraph), depsgraph.scene
    if evaluated.is_evaluated or depsgraph.mode == "RENDER":
        return tracing_camera(evaluated, scene, size)
    with cameras_alone(scene, size) as view:
        return view(camera, scene.frame_current, scene.frame_subframe)


@contextmanager
def cameras_alone(
    scene: bpy.types.Scene, size: tuple[int, int]
) -> Iterator[Callable[[bpy.types.Object, int, float], Camera]]:
    """Within the block, views of cameras by frame and subframe, which evaluate nothing else of their scene."""
    with kept_values(), temporary(bpy.data.scenes.new("PatchNet Camera")) as stage:
        layer = stage.view_layers[0]

        def view(camera: bpy.types.Object, frame: int, subframe: float) -> Camera:
            # frame_set would call the handlers of add-ons.
            stage.frame_current, stage.frame_subframe = frame, subframe
            stage.camera = camera  # Blender evaluates the scene's camera also when it is hidden
            layer.update()
            return tracing_camera(camera.evaluated_get(layer.depsgraph), scene, size)

        yield view
    sync_view_layers()


def focus_warnings(scene: bpy.types.Scene, cameras: Sequence[Camera]) -> tuple[str, ...]:
    """Sentence that names the chosen cameras with depth of field, which previews leave out."""
    there = scene_cameras(scene)
    names = dict.fromkeys(each.name for each in cameras if each.name in there and there[each.name].data.dof.use_dof)
    if not names:
        return ()
    have = f"Camera {named_list(names)} has" if len(names) == 1 else f"Cameras {named_list(names)} have"
    return (f"{have} depth of field, but previews show all in focus: render with Cycles for the blur",)
