# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras against Blender's own projection."""

from pathlib import Path

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Euler, Matrix, Vector

from patchnet.operators.pipeline.output_files import view_folders
from patchnet.operators.scene.cameras import (
    camera_names,
    choose_cameras,
    focus_warnings,
    looking_cameras,
    tracing_camera,
)
from patchnet.operators.scene.read import read_scene
from patchnet.patchnet_addon.lod.depth import coarse_octree
from patchnet.patchnet_addon.runtime.errors import SceneError
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.tests.blender.objects import group, new_camera, slid


@pytest.fixture
def camera() -> bpy.types.Object:
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.context.scene.camera = camera = new_camera("Eye")
    camera.data.name = "Lens"
    camera.matrix_world = Matrix.Translation((3.0, -5.0, 2.0)) @ Euler((1.1, 0.2, 0.4)).to_matrix().to_4x4()
    return camera


def picture_point(camera, point_world: np.ndarray) -> np.ndarray:
    """Project a world point by our camera: (x, y) in [0, 1], and its axial distance."""
    offset = point_world - camera.position_world
    z = offset @ camera.forward
    scale = z if camera.kind == "PERSP" else 1.0
    x = offset @ camera.right / scale / camera.half_x - camera.shift_x
    y = offset @ camera.up / scale / camera.half_y - camera.shift_y
    return np.array([(x + 1) / 2, (y + 1) / 2, z])


@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
@pytest.mark.parametrize("fit", ["AUTO", "HORIZONTAL", "VERTICAL"])
@pytest.mark.parametrize("size", [(192, 192), (320, 180), (90, 160)])
def test_projection_is_blenders(camera: bpy.types.Object, kind: str, fit: str, size: tuple[int, int]) -> None:
    scene, data = bpy.context.scene, camera.data
    data.type, data.sensor_fit, data.lens, data.ortho_scale = kind, fit, 35.0, 7.0
    data.sensor_width, data.sensor_height = 32.0, 18.0
    data.shift_x, data.shift_y = 0.15, -0.3
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = *size, 100
    bpy.context.view_layer.update()
    ours = tracing_camera(camera, scene)
    assert (ours.width_px, ours.height_px) == size
    rng = np.random.default_rng(0)
    for point in rng.uniform(-4, 4, (20, 3)) + [-2.0, 5.0, 1.0]:
        expected = np.array(world_to_camera_view(scene, camera, Vector(point)))
        np.testing.assert_allclose(picture_point(ours, point), expected, rtol=2e-5, atol=2e-5)


@pytest.mark.parametrize(("scale", "right"), [((0.3, 2.0, 5.0), 1), ((-2.0, 2.0, 2.0), -1)])
def test_of_the_scale_of_the_object_a_mirroring_sign_matters(
    camera: bpy.types.Object, scale: tuple[float, float, float], right: int
) -> None:
    bpy.context.view_layer.update()
    before = tracing_camera(camera, bpy.context.scene)
    camera.scale = scale
    bpy.context.view_layer.update()
    after = tracing_camera(camera, bpy.context.scene)
    for name, sign in {"right": right, "up": 1, "forward": 1, "position_world": 1}.items():
        np.testing.assert_allclose(getattr(after, name), sign * getattr(before, name), atol=1e-6)
    np.testing.assert_allclose(np.stack([after.right, after.up, after.forward]) @ after.forward, [0, 0, 1], atol=1e-9)


def test_panoramas_are_refused(camera: bpy.types.Object) -> None:
    camera.data.type = "PANO"
    with pytest.raises(SceneError, match=r"'Eye'.*perspective or orthographic"):
        tracing_camera(camera, bpy.context.scene)


def test_names(camera: bpy.types.Object) -> None:
    scene = bpy.context.scene
    new_camera("Second")
    depsgraph = bpy.context.evaluated_depsgraph_get()
    bounds = np.array([[-1.0, -1, -1], [1, 1, 1]])

    def names(*wanted: str) -> list[str]:
        return [camera.name for camera in choose_cameras(depsgraph, wanted, (64, 64), bounds)]

    assert names() == ["Eye"]
    assert names("all") == ["Eye", "Second"]
    assert names("Second", "Eye", "Second") == ["Second", "Eye"]
    with pytest.raises(SceneError, match=r"no camera 'Third'.*'Eye', 'Second'"):
        names("Third")
    scene.camera = None
    with pytest.raises(SceneError, match="no camera"):
        names()


def test_depth_of_field_is_told_of_chosen_cameras_alone(camera: bpy.types.Object) -> None:
    scene = bpy.context.scene
    new_camera("Second").data.dof.use_dof = True

    def told(*wanted: str) -> tuple[str, ...]:
        bounds = np.array([[-1.0, -1, -1], [1, 1, 1]])
        return focus_warnings(scene, choose_cameras(bpy.context.evaluated_depsgraph_get(), wanted, (64, 64), bounds))

    assert told() == told("auto") == ()
    (text,) = told("all")
    assert text.startswith("Camera 'Second' has depth of field, but previews show all in focus")
    camera.data.dof.use_dof = True
    (text,) = told("all")
    assert text.startswith("Cameras 'Eye', 'Second' have depth of field")


@pytest.mark.parametrize("size", [(64, 64), (128, 64), (64, 128)])
def test_framing_cameras_see_the_scene(camera: bpy.types.Object, size: tuple[int, int]) -> None:
    bounds = np.array([[1.0, -2, 0], [7, 3, 4]])
    depsgraph = bpy.context.evaluated_depsgraph_get()
    before = len(bpy.data.objects), len(bpy.data.cameras)
    cameras = choose_cameras(depsgraph, ["auto"], size, bounds)
    assert [camera.name for camera in cameras] == ["Far", "Middle", "Close"]
    assert (len(bpy.data.objects), len(bpy.data.cameras)) == before
    corners = np.array(np.meshgrid(*bounds.T)).reshape(3, -1).T
    widths = []
    for view in cameras:
        points = np.array([picture_point(view, corner)[:2] for corner in corners])
        widths.append(np.ptp(points, axis=0).max())
        if view.name != "Close":
            assert points.min() >= 0.0 and points.max() <= 1.0
    assert widths[0] < 0.6 * widths[1] and widths[1] > 0.5


@pytest.mark.parametrize("inwards", [True, False])
def test_auto_goes_inside_a_room(inwards: bool) -> None:
    """Of a room whose walls face inwards; of the same box from outside otherwise. The octree says the same."""
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.mesh.primitive_cube_add(size=4.0, location=(10.0, 0.0, 2.0))
    if inwards:
        bpy.context.object.data.flip_normals()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    source = read_scene(depsgraph, "VISIBLE")
    for surface in (source, drain(coarse_octree(source, 6))):
        cameras = drain(looking_cameras(depsgraph, ["auto"], (64, 48), source.bounds_world, surface))
        low, high = source.bounds_world
        inside = [bool(((low < view.position_world) & (view.position_world < high)).all()) for view in cameras]
        assert inside == [inwards] * 3 and {view.width_px for view in cameras} == {64}
        assert {view.name for view in cameras} <= set(camera_names(bpy.context.scene, ["auto"]))


def test_a_camera_by_numbers(camera: bpy.types.Object) -> None:
    depsgraph = bpy.context.evaluated_depsgraph_get()
    bounds = np.array([[-1.0] * 3, [1.0] * 3])
    eye, own = choose_cameras(depsgraph, ("Eye", "1 -5 1.5 > 1 0 1.5 @ 90"), (64, 32), bounds)
    assert eye.name == "Eye" and own.name == "1 -5 1.5 > 1 0 1.5 @ 90" and own.half_y == pytest.approx(1.0)
    assert own.position_world.tolist() == [1.0, -5.0, 1.5] and own.forward == pytest.approx([0.0, 1.0, 0.0])
    assert set(view_folders(bpy.context.scene, ("Eye", own.name))) == {"Eye", own.name}
    wrong = [
        ("1 2 > 3 4 5", "is not a view"),
        ("1 2 3 > 1 2 3", "target at its position"),
        ("1 2 3 > 4 5 6 @ 180", "180"),
    ]
    for text, why in wrong:
        with pytest.raises(SceneError, match=why):
            choose_cameras(depsgraph, (text,), (64, 32), bounds)


@pytest.mark.parametrize(
    ("hidden", "active"),
    [
        ("excluded collection", False),
        ("excluded collection", True),
        ("disabled in viewports", False),
        ("hidden", False),
    ],
)
def test_cameras_that_the_view_layer_leaves_out(
    camera: bpy.types.Object, hidden: str, active: bool, tmp_path: Path
) -> None:
    """With a parent that is animated and a constraint, at the scene's frame; as they are when nothing hides them."""
    scene = bpy.context.scene
    rig, target = (bpy.data.objects.new(name, None) for name in ("Rig", "Target"))
    collection = group("Cameras", rig, target, camera)
    camera.parent, target.location, rig.scale = rig, (1.0, 2.0, 0.5), (2.0, 1.0, 1.0)
    slid(rig, {1: 0.0, 11: 10.0})
    constraint = camera.constraints.new("TRACK_TO")
    constraint.target, constraint.track_axis, constraint.up_axis = target, "TRACK_NEGATIVE_Z", "UP_Y"
    scene.frame_set(4)
    bounds = np.array([[-1.0] * 3, [1.0] * 3])
    (wanted,) = choose_cameras(bpy.context.evaluated_depsgraph_get(), ("Eye",), (64, 64), bounds)
    assert wanted.position_world[0] > 3.0
    scene.camera = camera if active else None
    layer = bpy.context.view_layer.layer_collection.children["Cameras"]
    if hidden == "excluded collection":
        layer.exclude = True
    elif hidden == "hidden":
        layer.hide_viewport = True
    else:
        for item in collection.objects:
            item.hide_viewport = True
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "file.blend"))  # a file that is opened knows no places
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "file.blend"))
    scene = bpy.context.scene
    scenes = len(bpy.data.scenes)
    (found,) = choose_cameras(bpy.context.evaluated_depsgraph_get(), ("Eye",), (64, 64), bounds)
    assert len(bpy.data.scenes) == scenes and scene.frame_current == 4
    for name in ("position_world", "right", "up", "forward"):
        np.testing.assert_allclose(getattr(found, name), getattr(wanted, name), atol=1e-5)
