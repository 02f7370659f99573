# SPDX-License-Identifier: GPL-3.0-or-later
"""Which octree the render engine shows in a frame: kept, stale, fitted to a track, lit as at the frame."""

from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet.operators.pipeline.lit_octree import LitOctree
from patchnet.operators.render_engine import frame_octree
from patchnet.operators.session import results
from patchnet.operators.session.scene_session import session_of
from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.patchnet_addon.runtime.progress import Steps
from patchnet.patchnet_addon.sampling.passes import NO_DEPTH
from patchnet.patchnet_addon.tracing.render import first_hits
from patchnet.tests.blender.engine_scene import build_for_engine, kept, passes_in, rendered
from patchnet.tests.blender.job_scene import frames_of_calls
from patchnet.tests.blender.objects import active_camera, geometry_nodes, slid


@pytest.fixture(autouse=True)
def scene(registered: None, weights: Path, tmp_path: Path) -> bpy.types.Scene:
    return build_for_engine(weights, tmp_path)


def test_the_octree_that_is_there_is_used_until_it_is_stale(scene: bpy.types.Scene) -> None:
    assert bpy.ops.patchnet.voxelize() == {"FINISHED"}
    octree = results.voxels_of(scene).octree
    rendered(scene)
    assert kept(scene).octree is octree  # and codes came with the render
    scene.objects["Slab"].location.z += 0.3
    bpy.context.view_layer.update()
    rendered(scene)
    assert kept(scene).octree is not octree and not kept(scene).stale


def test_voxels_that_do_not_fit_are_shown_where_none_can_be_made(
    scene: bpy.types.Scene, capfd: pytest.CaptureFixture[str]
) -> None:
    """Of objects that are selected, with none selected by now; with a warning."""
    scene.patchnet.scope = "SELECTED"
    for item in scene.objects:
        item.select_set(item.type == "MESH")
    whole = rendered(scene)["Combined"]
    octree = kept(scene).octree
    bpy.ops.object.select_all(action="DESELECT")
    scene.objects["Slab"].location.z += 0.01
    bpy.context.view_layer.update()
    shown = rendered(scene)["Combined"]
    assert np.array_equal(shown, whole) and kept(scene).octree is octree and kept(scene).stale == {"surface"}
    said = "".join(capfd.readouterr())
    assert "No selected object has a surface" in said and "outdated voxels are shown" in said


def test_a_moving_camera_reuses_the_octree_and_a_moving_lath_does_not(
    scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = frames_of_calls(monkeypatch, frame_octree, "build_lit_octree")
    scene.frame_start, scene.frame_end = 1, 3
    folder = Path(scene.render.filepath).parent
    slid(scene.camera, {1: 0.3, 3: 0.8})
    bpy.ops.render.render(animation=True)
    assert made == [1]
    first, last = (passes_in(folder / f"picture-{number:04d}.exr") for number in (1, 3))
    assert not np.array_equal(first["Level"], last["Level"])
    made.clear()
    slid(scene.objects["Lath 2"], {1: 0.0, 2: 0.1, 3: 0.1})
    bpy.ops.render.render(animation=True)
    assert made == [1, 2]
    moved = passes_in(folder / "picture-0003.exr")
    assert not np.array_equal(moved["Level"], last["Level"])
    made.clear()
    scene.objects["Lath 2"].animation_data_clear()
    for frame, hidden in ((1, True), (3, False)):
        scene.objects["Lath 1"].hide_render = hidden
        scene.objects["Lath 1"].keyframe_insert("hide_render", frame=frame)
    scene.frame_set(1)
    bpy.ops.render.render(animation=True)
    assert made == [1, 3], "an object that appears later"


def test_automatic_voxels_serve_the_camera_at_all_frames(
    scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If only the camera moves; else each frame's voxels serve its own camera."""
    made: list[Octree] = []
    build_octree = frame_octree.build_lit_octree

    def noted(*inputs: object) -> Steps[LitOctree]:
        lit = yield from build_octree(*inputs)
        made.append(lit.octree)
        return lit

    monkeypatch.setattr(frame_octree, "build_lit_octree", noted)
    scene.patchnet.resolution = "AUTO"
    scene.objects["Slab"].scale = (0.25, 1.0, 0.25)
    scene.camera.data.lens = 480.0
    scene.frame_start, scene.frame_end = 1, 3
    slid(scene.camera, {1: 0.3, 3: 0.5})
    scene.frame_set(1)
    rendered(scene)
    bpy.ops.render.render(animation=True)
    still, whole = made
    assert share_ahead(scene, whole) > 0.95 > 0.8 > share_ahead(scene, still)
    slid(scene.objects["Lath 2"], {1: 0.0, 3: 0.001})
    bpy.ops.render.render(animation=True)
    assert len(made) == 5 and max(octree.leaf_count for octree in made[2:]) < whole.leaf_count


def test_a_frame_alone_is_that_of_the_animation(scene: bpy.types.Scene) -> None:
    """With All Frames, whichever frame comes first; without, its voxels serve its own camera."""
    scene.patchnet.resolution, scene.patchnet.track = "AUTO", True
    scene.objects["Slab"].scale = (0.25, 1.0, 0.25)
    scene.camera.data.lens = 480.0
    scene.frame_start, scene.frame_end = 1, 4
    slid(scene.camera, {1: 0.3, 4: 0.6})
    folder = Path(scene.render.filepath).parent
    bpy.ops.render.render(animation=True)
    whole, leaves = passes_in(folder / "picture-0003.exr"), kept(scene).octree.leaf_count
    for track in (True, False):
        results.forget(scene)
        session_of(scene).made_frame = None
        scene.patchnet.track = track
        scene.frame_set(3)
        alone = rendered(scene)
        assert (kept(scene).octree.leaf_count == leaves) == track
        for name in ("Combined", "Level", "Depth") if track else ():
            assert np.array_equal(alone[name], whole[name]), name


@pytest.mark.parametrize("what", ["geometry nodes", "keyframes of one value", "time that changes nothing", "time"])
def test_what_does_not_move_is_voxelized_once(
    scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    """Rendered as stills, one frame after the other."""
    lath = scene.objects["Lath 2"]
    if what == "keyframes of one value":
        for frame in (1, 50):
            lath.keyframe_insert("location", frame=frame)
    else:
        tree, given, made_of = geometry_nodes(lath)
        moved = tree.nodes.new("GeometryNodeTransform")
        tree.links.new(given, moved.inputs["Geometry"])
        tree.links.new(moved.outputs["Geometry"], made_of)
        if what != "geometry nodes":
            time = tree.nodes.new("GeometryNodeInputSceneTime").outputs["Frame"]
            scaled = tree.nodes.new("ShaderNodeMath")
            scaled.operation, scaled.inputs[1].default_value = "MULTIPLY", 0.01 if what == "time" else 0.0
            tree.links.new(time, scaled.inputs[0])
            tree.links.new(scaled.outputs[0], moved.inputs["Translation"])
    made = frames_of_calls(monkeypatch, frame_octree, "build_lit_octree")
    for frame in (1, 20, 40):
        scene.frame_set(frame)
        rendered(scene)
    assert made == ([1, 20, 40] if what == "time" else [1])
    assert (kept(scene).state.frame is None) == (what in ("geometry nodes", "keyframes of one value"))


def test_settings_that_changed_since_count_without_a_window(scene: bpy.types.Scene) -> None:
    assert bpy.ops.patchnet.voxelize() == {"FINISHED"}
    scene.patchnet.depth = 5
    rendered(scene)
    assert kept(scene).octree.depth == 5


def share_ahead(scene: bpy.types.Scene, octree: Octree) -> float:
    """Smallest share of hit pixels with look-ahead at the frames of a scene."""
    shares = []
    for frame in range(scene.frame_start, scene.frame_end + 1):
        scene.frame_set(frame)
        hits = first_hits(octree, active_camera())
        assert hits.hit.mean() > 0.1
        shares.append(float(octree.look_ahead()[hits.node[hits.hit]].mean()))
    return min(shares)


@pytest.mark.parametrize("moving", [True, False], ids=["all of it", "the world alone"])
def test_what_is_baked_is_lit_as_at_its_frame(scene: bpy.types.Scene, moving: bool) -> None:
    """Against a still of the same frame: Blender leaves data-blocks as they are while it goes from frame to frame."""
    scene.patchnet.light, scene.patchnet.max_samples = "cycles", 64
    lath, lamp = scene.objects["Lath 2"], bpy.data.lights.new("Lamp", "SUN")
    scene.collection.objects.link(bpy.data.objects.new("Lamp", lamp))
    strength = scene.world.node_tree.nodes["Background"].inputs["Strength"]
    for frame, x, energy, world in ((1, 0.0, 1.0, 0.5), (2, 0.3, 3.0, 1.0)):
        strength.default_value = world
        strength.keyframe_insert("default_value", frame=frame)
        if moving:
            lath.location.x, lamp.energy = x, energy
            lath.keyframe_insert("location", index=0, frame=frame)
            lamp.keyframe_insert("energy", frame=frame)
    scene.frame_start, scene.frame_end = 1, 2
    scene.frame_set(1)
    before = lath.location.x, lamp.energy
    folder = Path(scene.render.filepath).parent
    bpy.ops.render.render(animation=True)
    assert (lath.location.x, lamp.energy, strength.default_value) == (*before, 0.5), "as the scene was left"
    begin, end = (passes_in(folder / f"picture-{frame:04d}.exr") for frame in (1, 2))
    first, second = begin["Combined"], end["Combined"]
    surface = (begin["Depth"] < NO_DEPTH)[..., 0]
    assert np.abs(second - first)[surface, :3].max(axis=-1).mean() > 0.08, "not of the background alone"
    results.forget(scene)
    session_of(scene).made_frame = None
    scene.frame_set(2)
    assert np.abs(second - rendered(scene)["Combined"]).mean() < 0.004, "but for noise"
