# SPDX-License-Identifier: GPL-3.0-or-later
"""The render engine in background: passes, stills, animations, importance, errors."""

import time
from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet.operators.render_engine import panels
from patchnet.operators.render_engine.engine import ENGINE
from patchnet.operators.render_engine.passes import BY_PRIORITY, PASSES
from patchnet.operators.render_engine.render_frame import pull
from patchnet.operators.scene import read
from patchnet.operators.session import results
from patchnet.patchnet_addon.process.computed import computed, leave_engine_process, use_engine_process
from patchnet.patchnet_addon.runtime.errors import StoppedError
from patchnet.patchnet_addon.runtime.progress import Progress, drain
from patchnet.patchnet_addon.sampling.passes import NO_DEPTH
from patchnet.patchnet_addon.sampling.pixel_buffers import PixelBuffers
from patchnet.patchnet_addon.sampling.refine import refined_mask, refinement_order
from patchnet.patchnet_addon.sampling.registry import STRATEGIES
from patchnet.patchnet_addon.sampling.trace import trace_view
from patchnet.patchnet_addon.tracing.pixel_filter import BOX_FILTER, EVEN_FOOTPRINT, rook_places
from patchnet.patchnet_addon.tracing.render import seen_above_white
from patchnet.patchnet_addon.tracing.supersample import spread_pixels, supersample_pixels
from patchnet.tests.blender.engine_scene import (
    HEIGHT,
    WIDTH,
    WORLD,
    build_for_engine,
    kept,
    rendered,
)
from patchnet.tests.blender.job_scene import box, principled
from patchnet.tests.blender.objects import active_camera


@pytest.fixture(autouse=True)
def scene(registered: None, weights: Path, tmp_path: Path) -> bpy.types.Scene:
    return build_for_engine(weights, tmp_path)


def expected(scene: bpy.types.Scene) -> PixelBuffers:
    """The pixels as `render_preview` traces it."""
    chosen = [STRATEGIES[scene.patchnet.strategy], STRATEGIES["patchnet"]]
    return drain(trace_view(kept(scene).octree, active_camera(), chosen, coded=kept(scene).coded))


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
    refined = supersample_pixels(kept(scene).octree, active_camera(), np.flatnonzero(mask))
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
    every = np.arange(WIDTH * HEIGHT)
    means = spread_pixels(
        result.octree, active_camera(), every, rook_places(4), BOX_FILTER, finer=EVEN_FOOTPRINT
    ).given[:, 0]
    combined = found["Combined"].reshape(-1, 4)
    assert np.allclose(combined[:, :3], means[:, :3] / result.octree.exposure, rtol=1e-5, atol=1e-6)
    assert np.allclose(combined[:, 3], means[:, 3], atol=1e-7)
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


def test_a_render_reads_its_scene_without_temporary_data(
    scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a window, data that its thread removed would crash Blender's drawing."""
    monkeypatch.setattr(read, "temporary_meshes", None)
    assert rendered(scene)["Combined"][..., 3].any()


def test_depth_and_normal_are_those_of_cycles(scene: bpy.types.Scene) -> None:
    """Seen from near with a wide lens, distance along the ray would be longer by half at the corners."""
    layer = bpy.context.view_layer
    layer.use_pass_z = layer.use_pass_normal = True
    bpy.data.batch_remove([item for item in scene.objects if item.name.startswith("Lath")])
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
    bpy.data.batch_remove([item for item in scene.objects if item.type == "MESH"])
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
    start = time.monotonic()
    use_engine_process()
    try:
        with pytest.raises(StoppedError):
            pull(Stopping(), computed(time.sleep, 60.0, at=Progress(0, 1, "Compiling")), 0.0, 1.0)
    finally:
        leave_engine_process()
    assert time.monotonic() - start < 60.0
