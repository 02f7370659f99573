# SPDX-License-Identifier: GPL-3.0-or-later
"""Refine with Cycles: chosen pixels are those of a full render, the scene stays unchanged."""

import json
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet.operators.computing.cycles_pixels import OWN_SIDE, CyclesView, wanted_pixels
from patchnet.operators.cycles import pixel_renders as renders
from patchnet.operators.cycles import scene_copy
from patchnet.operators.pipeline.cycles_refine import refine_view, wanted_surface
from patchnet.operators.pipeline.run import JobResult
from patchnet.operators.schema.values import COMBINED
from patchnet.operators.session import results
from patchnet.operators.settings.cycles_settings import CyclesSettings
from patchnet.patchnet_addon.runtime.errors import SceneError, SettingError
from patchnet.patchnet_addon.runtime.progress import Steps, drain
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.patchnet_addon.tracing.pixel_filter import EVEN_FOOTPRINT
from patchnet.patchnet_addon.tracing.supersample import supersample_pixels
from patchnet.tests.blender.full_scene import build_full
from patchnet.tests.blender.job_scene import box, build, drop_result_images, principled, ran
from patchnet.tests.blender.objects import active_camera, new_camera
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot

pytestmark = pytest.mark.usefixtures("registered")

SIZE = (40, 24)
CYCLES = CyclesSettings(budget=0.2, samples=32, compare=True)
STOPS = 6


def job(weights: Path, cycles: CyclesSettings | None = CYCLES, **values: object) -> JobResult:
    return ran(depth=7, max_samples=2, size=SIZE, weights=weights, cycles=cycles, **values)


@pytest.mark.parametrize(("light", "color"), [(True, False), (False, True)])
def test_inside_is_a_render_and_outside_are_own_rays(light: bool, color: bool, weights: Path) -> None:
    build(light=light)
    before = scene_snapshot()
    result = job(weights, color=color)
    assert_unchanged(before)
    (view,) = result.cycles
    assert view.full is not None
    assert view.composited.shape == ((24, 40, 3) if color else (24, 40))
    assert_same(view.composited[view.mask], view.full[view.mask])
    np.testing.assert_array_equal(view.composited[~view.mask], outside(view, result)[~view.mask])
    assert (view.composited[view.mask] != view.preview[view.mask]).any(), "Cycles' pixels are others"
    assert view.composited.max() > 0.2
    check_figures(view)
    assert result.report["frames"][0]["cycles"] is view.report


def outside(view: CyclesView, result: JobResult) -> np.ndarray:
    """The octree's own rays in all pixels."""
    pixels = np.arange(view.mask.size)
    own = supersample_pixels(result.coded.octree, view.camera, pixels, OWN_SIDE, finer=EVEN_FOOTPRINT)
    picture = own.luminance if view.composited.ndim == 2 else own.colors
    return np.minimum(picture, 1.0).reshape(view.composited.shape)


def check_figures(view: CyclesView) -> None:
    report = view.report
    assert report["pixels_share"] == view.mask.mean() == CYCLES.budget
    chosen, left = view.priority[view.mask], view.priority[~view.mask]
    assert chosen.min() >= left.max() and report["priority_share"] > report["pixels_share"]
    seconds = report["seconds"]
    assert 0.0 < seconds["of_that_reading_the_scene"] < seconds["pixels"] and seconds["full"] > 0.0
    mse = report["mse"]
    assert mse["full"] < mse["composited"] < mse["composited_over_unrefined"] < mse["preview"]
    assert mse["composited"] < mse["refined_octree"]
    json.dumps(report, allow_nan=False)


def test_pixels_are_rendered_at_once_or_in_parts_with_the_same_bits(
    weights: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    build()
    settings = CyclesSettings(budget=0.5, samples=4)
    whole = job(weights, settings).cycles[0]
    monkeypatch.setattr(renders, "FIRST_PATHS", 100)
    monkeypatch.setattr(renders, "PART_S", 0.0)
    labels = []
    parts = job(weights, settings, hear=lambda report: labels.append(report.label)).cycles[0]
    np.testing.assert_array_equal(parts.composited, whole.composited)
    assert parts.full is None and parts.errors == {}
    assert labels.count("Eye: Cycles") > 20, "of each row one"


def special_scene() -> None:
    """The small scene with a small mirror, a small block of glass, and a little mist."""
    build()
    for name, x, z in (("Mirror", -0.7, 0.7), ("Pane", 1.0, 0.7), ("Mist", 1.0, -0.6)):
        box(name, (x, -1.5, z), (x + 0.25, -1.25, z + 0.25), 0.8)
    principled("Mirror").inputs["Metallic"].default_value = 1.0
    glass = principled("Pane")
    glass.inputs["Transmission Weight"].default_value, glass.inputs["Roughness"].default_value = 1.0, 0.0
    tree = bpy.data.materials["Mist"].node_tree
    volume, output = tree.nodes.new("ShaderNodeVolumeScatter"), tree.get_output_node("ALL")
    volume.inputs["Density"].default_value = 100.0
    tree.links.remove(output.inputs["Surface"].links[0])
    tree.links.new(volume.outputs[0], output.inputs["Volume"])
    bpy.context.view_layer.update()


def test_pixels_that_only_cycles_shows_are_rendered_first(weights: Path) -> None:
    special_scene()
    wanted = wanted_pixels(wanted_surface(bpy.context.evaluated_depsgraph_get()), active_camera(SIZE)).mask
    alone = {}
    for name in ("Mirror", "Pane", "Mist"):
        others = [item for item in bpy.context.scene.objects if item.type == "MESH" and item.name != name]
        for item in others:
            item.hide_render = True
        alone[name] = whole_picture(samples=64)[..., 3]
        for item in others:
            item.hide_render = False
    seen = np.max(list(alone.values()), axis=0)
    assert all((alpha > 0.9).sum() > 1 for alpha in alone.values()), {name: item.max() for name, item in alone.items()}
    assert wanted[seen > 0.9].all() and not wanted[seen == 0.0].any()
    result = job(weights, None, gloss="off")
    traced = result.views[0]

    def refined(budget: float) -> CyclesView:
        settings = CyclesSettings(budget=budget, samples=2)
        return drain(refine_view(bpy.context, traced, settings, sun=None))

    view = refined(0.15)
    assert view.mask[wanted].all() and view.warnings == () and view.report["wanted"]["left_share"] == 0.0
    mist = view.composited[alone["Mist"] > 0.9]
    assert mist.min() > 0.0, "with its light, which is no diffuse one"
    assert "raise Pixels" in refined(0.005).warnings[0]


def test_what_fills_the_picture_is_wanted_from_inside() -> None:
    special_scene()
    camera, surface = active_camera(SIZE), wanted_surface(bpy.context.evaluated_depsgraph_get())
    around = np.array([[x, y, z] for x in (-9.0, 9.0) for y, z in ((-9.0, -9.0), (-9.0, 9.0), (9.0, 9.0), (9.0, -9.0))])
    assert wanted_pixels(surface._replace(boxes=around[None]), camera).mask.all()
    far = around / 9.0 * 0.2 + (1.5, 2.0, 0.0)
    before, beside = wanted_pixels(surface, camera).mask, wanted_pixels(surface._replace(boxes=far[None]), camera).mask
    assert not (before & ~beside).any() and (beside & ~before).any()


def whole_picture(samples: int = 4, seed: int = 0, camera: Camera | None = None) -> np.ndarray:
    """All of the picture, by a scene copy of its own."""
    with renders.pixel_renders(bpy.context, camera or active_camera(SIZE), COMBINED) as cycles:
        return drain(cycles.picture(samples, seed, "Cycles"))


def assert_same(first: np.ndarray, second: np.ndarray) -> None:
    """Two pictures of the same paths, but for the rounding of other pixels' sums."""
    np.testing.assert_allclose(first, second, rtol=1e-5, atol=1e-6)


def moved(kind: str) -> Camera:
    """The small scene's camera, shifted, orthographic, with sight that begins far away, or in a scene far away."""
    camera = active_camera(SIZE)
    if kind == "shifted":
        return replace(camera, shift_x=0.4, shift_y=-0.3)
    if kind == "orthographic":
        return replace(camera, kind="ORTHO", half_x=1.8, half_y=1.8 * SIZE[1] / SIZE[0])
    if kind == "clipped":
        return replace(camera, clip_start=4.0)
    for item in bpy.context.scene.objects:
        if item.parent is None:
            item.location.x += 20_000.0
    bpy.context.view_layer.update()
    return active_camera(SIZE)


@pytest.mark.parametrize("kind", ["shifted", "orthographic", "clipped", "far away"])
def test_scattered_pixels_are_those_of_the_whole_picture(kind: str) -> None:
    build()
    camera = moved(kind)
    mask = np.random.default_rng(2).random(SIZE[::-1]) < 0.3
    mask[:4, :4] = mask[-4:, -4:] = np.eye(4, dtype=bool)
    surface = wanted_surface(bpy.context.evaluated_depsgraph_get())
    chosen = renders.Chosen(mask, wanted_pixels(surface, camera).depth_world)
    before = scene_snapshot()
    with renders.pixel_renders(bpy.context, camera, COMBINED, chosen) as cycles:
        part = drain(cycles.picture(4, 0, "Cycles"))
    assert_unchanged(before)
    full = whole_picture(camera=camera)
    assert (full[..., 3] > 0.0).any() and not part[~mask].any()
    assert_same(part[mask], full[mask])


def test_a_view_layer_overrides_materials_but_not_samples() -> None:
    build()
    layer = bpy.context.view_layer
    layer.material_override = bpy.data.materials.new("Grey")
    full, layer.samples, mask = whole_picture(), 1, np.zeros(SIZE[::-1], bool)
    mask[8:16, 10:30] = True
    with renders.pixel_renders(bpy.context, active_camera(SIZE), COMBINED, renders.Chosen(mask, 1.0)) as cycles:
        part = drain(cycles.picture(4, 0, "Cycles"))
    assert_same(part, np.where(mask[..., None], full, 0.0))
    with pytest.raises(SettingError, match="no picture of 2 x 24 pixels"):
        whole_picture(camera=active_camera(SIZE).with_size(2, 24))


def test_other_samples_of_a_kept_scene_are_those_of_a_new_one() -> None:
    """Blender does not tell Cycles of every change of a setting."""
    build()
    with renders.pixel_renders(bpy.context, active_camera(SIZE), COMBINED) as cycles:
        first, second = (drain(cycles.picture(samples, seed, "Cycles")) for samples, seed in ((4, 0), (16, 1)))
    np.testing.assert_array_equal(second, whole_picture(samples=16, seed=1))
    assert (first != second).any()


def test_a_marker_with_another_camera_changes_nothing() -> None:
    build()
    camera = active_camera(SIZE)
    before = whole_picture(camera=camera)
    other = new_camera("Elsewhere")
    bpy.context.scene.timeline_markers.new("Cut", frame=1).camera = other
    np.testing.assert_array_equal(whole_picture(camera=camera), before)
    assert [marker.camera for marker in bpy.context.scene.timeline_markers] == [other]


def test_what_cycles_says_moves_the_progress() -> None:
    status = scene_copy._Status()
    status.check_finished()  # no word of it is none against it
    said = [
        ("Mem: 1M | Synchronizing object | Sample 3", 0.0),
        ("Mem: 1M | Sample 0/4", 0.0),
        ("Remaining: 00:01.04 | Mem: 1M | Sample 1/4", 0.25),
        ("Fra:1 Mem:9M (Peak 9M) | Scene.001, ViewLayer | Rendered 0/2 Tiles, Sample 3/4", 0.375),
        ("Mem: 1M | Rendered 0/2 Tiles, Sample 4/4", 0.375),
        ("Mem: 1M | Rendered 1/2 Tiles, Sample 4/4", 0.5),
        ("Mem: 1M | Out of memory", 0.5),
    ]
    for text, done in said:
        status.hear(text, None)
        assert status.done == done
    with pytest.raises(SceneError, match="Out of memory"):
        status.check_finished()
    for text in ("Mem: 1M | Finished", "Mem: 1M | ViewLayer | Finishing", "Time: 00:02.28 (Saving: 00:00.00)"):
        status.hear(text, None)
    status.check_finished()


def test_cycles_says_so_when_it_has_finished() -> None:
    """In this Blender, in tiles and without."""
    build()
    for side in (8, 2048):
        status = scene_copy._Status()
        bpy.app.handlers.render_stats.append(status.hear)
        try:
            with renders.pixel_renders(bpy.context, active_camera(SIZE), COMBINED) as cycles:
                cycles._scene.cycles.use_auto_tile, cycles._scene.cycles.tile_size = True, side
                drain(cycles.picture(4, 0, "Cycles"))
        finally:
            bpy.app.handlers.render_stats.remove(status.hear)
        assert status._finished and status.done > 0.0


def test_a_budget_of_nothing_and_of_all(weights: Path) -> None:
    build()
    nothing = job(weights, CyclesSettings(budget=0.0, samples=1)).cycles[0]
    assert nothing.report["seconds"]["pixels"] == 0.0
    combined = CyclesSettings(budget=1.0, samples=32, light=COMBINED, compare=True)
    everything = job(weights, combined).cycles[0]
    assert everything.mask.all()
    assert_same(everything.composited, everything.full)


def test_stopped_anywhere_the_scene_is_as_before(weights: Path, tmp_path: Path) -> None:
    build_full(tmp_path, "EDIT")
    result = job(weights, None)
    view = result.views[0]
    before = scene_snapshot()

    def steps() -> Steps[CyclesView]:
        return refine_view(bpy.context, view, CYCLES, sun=None)

    count = len(list(steps()))
    assert_unchanged(before)
    for stop in range(0, count, max(1, count // STOPS)):
        stopped = steps()
        for _ in range(stop + 1):
            next(stopped)
        stopped.close()
        assert_unchanged(before)


def test_operator_leaves_pictures_and_nothing_else(weights: Path, tmp_path: Path) -> None:
    build_full(tmp_path, "OBJECT")
    bpy.context.scene.patchnet.weights = str(weights)
    with pytest.raises(RuntimeError, match="not prepared yet"):
        bpy.ops.patchnet.refine_with_cycles()
    bpy.ops.patchnet.run_all(depth=7, max_samples=2, size=SIZE)
    drop_result_images()
    before = scene_snapshot()
    values = {"cycles_budget": 0.3, "cycles_samples": 2, "cycles_compare": True}
    assert bpy.ops.patchnet.refine_with_cycles(size=SIZE, **values) == {"FINISHED"}
    name = bpy.context.scene.camera.name
    for kind in ("cycles", "cycles mask", "cycles full"):
        assert tuple(bpy.data.images[f"PatchNet {name} {kind}"].size) == SIZE
    assert f"PatchNet {name} cycles error" in bpy.data.images
    drop_result_images()
    assert_unchanged(before)
    assert "cycles" in results.voxels_of(bpy.context.scene).notes
    assert bpy.ops.patchnet.render_preview(size=SIZE) == {"FINISHED"}
    assert "cycles" not in results.voxels_of(bpy.context.scene).notes, "they were of the picture before"


def test_light_that_is_not_cycles_is_refused(weights: Path) -> None:
    build()
    bpy.ops.patchnet.run_all(depth=5, light="two-lights", size=(16, 16), weights=str(weights))
    with pytest.raises(RuntimeError, match="no light from Cycles: run Bake Light"):
        bpy.ops.patchnet.refine_with_cycles()
