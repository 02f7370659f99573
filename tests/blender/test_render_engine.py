# SPDX-License-Identifier: GPL-3.0-or-later
"""The render engine in background: passes, stills, animations, importance, errors."""

import threading
from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet.operators.pipeline.lit_octree import LitOctree
from patchnet.operators.render_engine import frame_octree, panels
from patchnet.operators.render_engine.engine import ENGINE
from patchnet.operators.render_engine.passes import BY_PRIORITY, NO_DEPTH, PASSES
from patchnet.operators.render_engine.render_frame import pull
from patchnet.operators.session import results
from patchnet.operators.session.scene_session import session_of
from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.patchnet_addon.runtime.errors import StoppedError
from patchnet.patchnet_addon.runtime.progress import Progress, Steps, drain
from patchnet.patchnet_addon.runtime.worker import computed
from patchnet.patchnet_addon.sampling.adaptive import EVEN_FOOTPRINT
from patchnet.patchnet_addon.sampling.pixel_buffers import PixelBuffers
from patchnet.patchnet_addon.sampling.refine import refined_mask, refinement_order
from patchnet.patchnet_addon.sampling.registry import STRATEGIES
from patchnet.patchnet_addon.sampling.trace import trace_view
from patchnet.patchnet_addon.tracing.render import first_hits, seen_above_white
from patchnet.patchnet_addon.tracing.supersample import supersample_pixels
from patchnet.tests.blender.engine_scene import (
    HEIGHT,
    WIDTH,
    WORLD,
    build_for_engine,
    camera,
    kept,
    passes_in,
    rendered,
)
from patchnet.tests.blender.job_scene import box, principled


@pytest.fixture(autouse=True)
def scene(registered: None, weights: Path, tmp_path: Path) -> bpy.types.Scene:
    return build_for_engine(weights, tmp_path)


def expected(scene: bpy.types.Scene) -> PixelBuffers:
    """The pixels as `render_preview` traces it."""
    chosen = [STRATEGIES[scene.patchnet.strategy], STRATEGIES["patchnet"]]
    return drain(trace_view(kept(scene).octree, camera(), chosen, coded=kept(scene).coded))


def hdr_highlights(scene: bpy.types.Scene, buffers: PixelBuffers) -> np.ndarray:
    """(P,): what the clamp has taken from the voxels that the preview shows."""
    return seen_above_white(kept(scene).octree, buffers.hits)[:, 0]


def test_passes_are_what_the_tracer_computes(scene: bpy.types.Scene) -> None:
    found = rendered(scene)
    assert set(found) == {item.name for item in PASSES}
    buffers = expected(scene)
    score = STRATEGIES[scene.patchnet.strategy].scores(buffers)
    mask = refined_mask(buffers, refinement_order(buffers, score), scene.patchnet.budget)
    assert 0.2 < mask.sum() / buffers.active.sum() < 0.4

    def picture(values: np.ndarray) -> np.ndarray:
        return buffers.picture(values.reshape(len(mask), -1).astype(np.float32))

    hits = buffers.hits
    assert np.array_equal(found["Priority"], picture(score))
    assert np.array_equal(found["Sample Count"], picture(np.where(mask, 1024, 1)))
    assert np.array_equal(found["Level"], picture(np.where(hits.hit, hits.level, -1)))
    assert np.array_equal(found["Depth"], picture(np.where(hits.hit, hits.z_world, NO_DEPTH)))
    assert np.array_equal(found["Coverage"], picture(np.where(hits.hit, buffers.prediction.coverage, 0.0)))
    length = np.linalg.norm(found["Normal"], axis=-1).ravel()
    assert np.allclose(length[hits.hit], 1.0, atol=1e-5) and not length[~hits.hit].any()
    combined = found["Combined"].reshape(-1, 4)
    light = (buffers.preview + hdr_highlights(scene, buffers))[~mask] / kept(scene).octree.exposure
    world = np.where(hits.hit[~mask], 0.0, 1.0)[:, None] * np.array(WORLD) * 0.5
    assert np.allclose(combined[~mask, :3], light[:, None] + world, atol=1e-6)
    assert (combined[:, 3] == 1.0).all()


def test_refined_pixels_are_the_reference_over_a_transparent_film(scene: bpy.types.Scene) -> None:
    scene.render.film_transparent = True
    scene.patchnet.strategy, scene.patchnet.budget = "ss-variance", 0.5
    found = rendered(scene)
    buffers = expected(scene)
    mask = refined_mask(buffers, refinement_order(buffers, STRATEGIES["ss-variance"].scores(buffers)), 0.5)
    combined = found["Combined"].reshape(-1, 4)
    exposure = kept(scene).octree.exposure
    refined = supersample_pixels(kept(scene).octree, camera(), np.flatnonzero(mask))
    assert np.array_equal(refined.luminance, buffers.reference[mask])
    assert np.allclose(combined[mask, :3], refined.colors / exposure, rtol=1e-5, atol=1e-6)
    assert np.array_equal(combined[~mask, 3], buffers.hit[~mask].astype(np.float32))
    partly = combined[mask, 3]
    assert ((partly > 0.0) & (partly < 1.0)).any()


def test_renders_have_sixteen_fine_rays_in_every_pixel_unless_they_are_by_priority(scene: bpy.types.Scene) -> None:
    scene.patchnet.property_unset("render_samples")
    scene.render.film_transparent = True
    found = rendered(scene)
    assert set(found) == {item.name for item in PASSES} - set(BY_PRIORITY)
    assert (found["Sample Count"] == 16.0).all()
    result = results.result_of(scene)
    assert result is not None and result.coded is None, "nothing looks ahead"
    means = supersample_pixels(result.octree, camera(), np.arange(WIDTH * HEIGHT), 4, finer=EVEN_FOOTPRINT)
    combined = found["Combined"].reshape(-1, 4)
    assert np.allclose(combined[:, :3], means.colors / result.octree.exposure, rtol=1e-5, atol=1e-6)
    assert np.array_equal(combined[:, 3], means.coverage)
    scene.patchnet.render_samples = 8.0
    assert (rendered(scene)["Sample Count"] == 9.0).all(), "3 x 3 is nearest"


def test_a_lamp_keeps_its_light_and_the_room_its_exposure(scene: bpy.types.Scene) -> None:
    """A strip that shines with 5.79, far above white, in a room whose brightest is below 1."""
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.0
    strip = box("Strip", (-0.9, -1.5, -0.2), (0.9, -1.45, 0.2), 0.0)
    rendered(scene)
    without = kept(scene).octree.exposure
    shader = principled("Strip")
    shader.inputs["Emission Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    shader.inputs["Emission Strength"].default_value = 5.79
    strip.update_tag()
    found = rendered(scene)
    octree = kept(scene).octree
    assert 1.0 / octree.exposure < 2.0 and octree.exposure == pytest.approx(without, rel=0.05)
    unrefined = found["Combined"][found["Sample Count"][..., 0] == 1]
    assert unrefined[..., :3].max() == pytest.approx(5.79, rel=2e-3)
    scene.patchnet.budget = 1.0
    found = rendered(scene)
    refined = found["Combined"][found["Sample Count"][..., 0] > 1]
    assert refined[..., :3].max() == pytest.approx(5.79, rel=2e-3)
    assert f"Exposure {octree.exposure:.4g} (automatic)" in kept(scene).summary


def test_depth_and_normal_are_those_of_cycles(scene: bpy.types.Scene) -> None:
    """Seen from near with a wide lens, distance along the ray would be longer by half at the corners."""
    layer = bpy.context.view_layer
    layer.use_pass_z = layer.use_pass_normal = True
    for item in list(scene.objects):
        if item.name.startswith("Lath"):
            bpy.data.objects.remove(item)
    scene.camera.location, scene.camera.data.lens = (0.2, -1.3, 0.1), 18.0
    scene.render.resolution_x, scene.render.resolution_y = 320, 208
    scene.patchnet.depth = 8
    found = rendered(scene)
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising = 1, False
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 0.01
    theirs = rendered(scene)
    both = (found["Depth"] < NO_DEPTH) & (theirs["Depth"] < 1e9)
    assert both.mean() > 0.2
    apart = np.abs(found["Depth"] - theirs["Depth"])[both]
    assert np.quantile(apart, 0.95) < 3 * kept(scene).octree.grid.voxel_size_world
    cosine = (found["Normal"] * theirs["Normal"]).sum(-1)[both[..., 0]]
    assert np.quantile(cosine, 0.2) > 0.95
    assert theirs["Depth"].max() == np.float32(NO_DEPTH)


@pytest.mark.parametrize("crop", [False, True])
def test_a_border_shows_the_same_pixels(scene: bpy.types.Scene, crop: bool) -> None:
    scene.patchnet.budget = 1.0
    whole = rendered(scene)
    render = scene.render
    render.use_border, render.use_crop_to_border = True, crop
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.2, 0.71, 0.13, 0.8
    columns, rows = slice(int(0.2 * WIDTH), int(0.71 * WIDTH)), slice(int(0.13 * HEIGHT), int(0.8 * HEIGHT))
    part = rendered(scene)
    for name in ("Combined", "Depth", "Priority", "Level"):
        inside = part[name] if crop else part[name][rows, columns]
        assert np.allclose(inside, whole[name][rows, columns], rtol=1e-4, atol=1e-5), name
    if not crop:
        assert not part["Combined"][: rows.start].any()


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
    made: list[int] = []
    build_octree = frame_octree.build_lit_octree

    def counted(context: bpy.types.Context, *rest: object) -> object:
        made.append(context.scene.frame_current)
        return build_octree(context, *rest)

    monkeypatch.setattr(frame_octree, "build_lit_octree", counted)
    scene.frame_start, scene.frame_end = 1, 3
    folder = Path(scene.render.filepath).parent
    _keys(scene.camera, [(1, 0.3), (3, 0.8)])
    bpy.ops.render.render(animation=True)
    assert made == [1]
    first, last = (passes_in(folder / f"picture-{number:04d}.exr") for number in (1, 3))
    assert not np.array_equal(first["Level"], last["Level"])
    made.clear()
    _keys(scene.objects["Lath 2"], [(1, 0.0), (2, 0.1), (3, 0.1)])
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
    _keys(scene.camera, [(1, 0.3), (3, 0.5)])
    scene.frame_set(1)
    rendered(scene)
    bpy.ops.render.render(animation=True)
    still, whole = made
    assert share_ahead(scene, whole) > 0.95 > 0.8 > share_ahead(scene, still)
    _keys(scene.objects["Lath 2"], [(1, 0.0), (3, 0.001)])
    bpy.ops.render.render(animation=True)
    assert len(made) == 5 and max(octree.leaf_count for octree in made[2:]) < whole.leaf_count


def share_ahead(scene: bpy.types.Scene, octree: Octree) -> float:
    """Smallest share of hit pixels with look-ahead at the frames of a scene."""
    shares = []
    for frame in range(scene.frame_start, scene.frame_end + 1):
        scene.frame_set(frame)
        hits = first_hits(octree, camera())
        assert hits.hit.mean() > 0.1
        shares.append(float(octree.look_ahead()[hits.node[hits.hit]].mean()))
    return min(shares)


def _keys(item: bpy.types.Object, places: list[tuple[int, float]]) -> None:
    for frame, x in places:
        item.location.x = x
        item.keyframe_insert("location", index=0, frame=frame)
    bpy.context.view_layer.update()


def test_errors_and_warnings_are_sentences(scene: bpy.types.Scene, capfd: pytest.CaptureFixture[str]) -> None:
    scene.render.use_multiview = True
    bpy.ops.render.render()
    assert "no stereo" in "".join(capfd.readouterr())
    scene.render.use_multiview = False
    results.forget(scene)
    scene.camera.data.type = "PANO"
    with pytest.raises(RuntimeError, match="choose a perspective or orthographic camera"):
        bpy.ops.render.render()
    scene.camera.data.type = "PERSP"
    for item in list(scene.objects):
        if item.type == "MESH":
            bpy.data.objects.remove(item)
    with pytest.raises(RuntimeError, match="No visible object has a surface"):
        bpy.ops.render.render()


def with_our_engine() -> set[str]:
    """Names of panels."""
    every = bpy.types.Panel.__subclasses__()
    return {panel.__name__ for panel in every if ENGINE in getattr(panel, "COMPAT_ENGINES", ())}


def test_the_properties_editor_is_not_empty() -> None:
    named = with_our_engine()
    assert {
        "DATA_PT_lens", "RENDER_PT_format", "RENDER_PT_output", "WORLD_PT_context_world", "EEVEE_WORLD_PT_surface",
        "EEVEE_MATERIAL_PT_surface", "DATA_PT_EEVEE_light", "RENDER_PT_color_management", "OBJECT_PT_visibility",
    } <= named  # fmt: skip
    panels.unregister()
    assert with_our_engine() == {item.__name__ for item in panels.CLASSES}
    panels.register()


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


def passes(scene: bpy.types.Scene) -> dict[str, np.ndarray]:
    """The passes (H, W) of a still, of one channel each."""
    return {name: values[..., 0] for name, values in rendered(scene).items() if values.shape[-1] == 1}


def test_a_vertex_group_follows_the_object_and_its_modifiers(scene: bpy.types.Scene) -> None:
    """With a weight of a half; what is off in viewports is painted in renders nevertheless."""
    plain = passes(scene)
    slab = scene.objects["Slab"]
    slab.vertex_groups.new(name="Matters").add(range(len(slab.data.vertices)), 0.5, "REPLACE")
    modifier = slab.modifiers.new("Shift", "DISPLACE")
    modifier.direction, modifier.mid_level, modifier.strength, modifier.show_viewport = "Y", 0.0, 0.4, False
    bpy.context.view_layer.update()
    moved = passes(scene)
    scene.patchnet.importance, scene.patchnet.importance_group = "VERTEX_GROUP", "Matters"
    scene.patchnet.budget = 1.0
    masked = passes(scene)
    assert not np.array_equal(plain["Depth"], moved["Depth"])
    behind = (masked["Depth"] > 5.3) & (masked["Level"] >= 0)
    before = masked["Depth"] < 5.0
    assert behind.any() and before.any()
    assert np.array_equal(masked["Priority"][behind], moved["Priority"][behind] * np.float32(0.5))
    assert not masked["Priority"][before].any() and (masked["Sample Count"][before] == 1).all()
    assert (masked["Sample Count"][behind] == 1024).all()


def test_what_is_not_there_is_said_before_anything_is_made(scene: bpy.types.Scene) -> None:
    scene.patchnet.importance, scene.patchnet.importance_image = "IMAGE", "Nobody"
    with pytest.raises(RuntimeError, match="Importance image 'Nobody' does not exist"):
        bpy.ops.render.render()
    scene.patchnet.importance, scene.patchnet.importance_group = "VERTEX_GROUP", "Nobody"
    with pytest.raises(RuntimeError, match="No voxelized object has the vertex group 'Nobody'"):
        bpy.ops.render.render()
    assert results.result_of(scene) is None


class Stopping:
    """Render engine as `pull` needs it, stopped at the third look."""

    looks = 0

    def update_stats(self, *_: object) -> None:
        """Nobody watches."""

    update_progress = update_stats

    def test_break(self) -> bool:
        self.looks += 1
        return self.looks == 3


def test_a_stop_is_heard_in_the_middle_of_a_step() -> None:
    go = threading.Event()
    with pytest.raises(StoppedError):
        pull(Stopping(), computed(lambda: go.wait(60.0), Progress(0, 1, "Compiling")), 0.0, 1.0)
    assert not go.is_set()
    go.set()
