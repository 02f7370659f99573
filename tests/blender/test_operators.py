# SPDX-License-Identifier: GPL-3.0-or-later
"""Every operator on a small scene: results, messages, an unchanged scene."""

import itertools
import json
import shutil
from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet.operators.pipeline.run import run_job
from patchnet.operators.scene_access.images import OF_REFERENCE, PICTURES, show_image
from patchnet.operators.session import results
from patchnet.operators.session.scene_session import open_sessions
from patchnet.operators.session.views import image_name
from patchnet.operators.settings.job_settings import JobSettings
from patchnet.patchnet_addon.codes.file import load_codes
from patchnet.patchnet_addon.network.weights import load_weights
from patchnet.patchnet_addon.octree.file import load_octree
from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.patchnet_addon.sampling.registry import STRATEGIES
from patchnet.tests.blender.job_scene import SMALL, build, drop_result_images, pixels_in, pixels_of, ran, run_small
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot

pytestmark = pytest.mark.usefixtures("scene")

FILES = {"preview.png", "predicted.png", "heatmap.png", "overlay.png", "priority.exr", "refined.png"}
WITHOUT_REFERENCE = [name for name in PICTURES if name not in OF_REFERENCE]


def test_steps_one_by_one(scene: bpy.types.Scene) -> None:
    before = scene_snapshot()
    assert bpy.ops.patchnet.voxelize(depth=7) == {"FINISHED"}
    unlit = results.voxels_of(scene)
    assert unlit.octree.depth == 7 and unlit.light == "none" and unlit.coded is None
    assert bpy.ops.patchnet.bake_light(light="two-lights") == {"FINISHED"}
    lit = results.voxels_of(scene)
    assert lit.light == "two-lights" and lit.octree.grid == unlit.octree.grid
    np.testing.assert_array_equal(lit.octree.child_mask, unlit.octree.child_mask)
    assert (lit.octree.luminance != unlit.octree.luminance).any()
    assert bpy.ops.patchnet.precompute_codes() == {"FINISHED"}
    assert len(results.codes_of(scene).codes) > 100
    assert_unchanged(before)
    assert bpy.ops.patchnet.render_preview(size=(24, 16)) == {"FINISHED"}
    assert results.voxels_of(scene).lookahead_share > 0.95
    for name in WITHOUT_REFERENCE:
        assert bpy.data.images[image_name("Eye", name)].colorspace_settings.name == "sRGB"
    raw = bpy.data.images["PatchNet Eye priority"]
    assert tuple(raw.size) == (24, 16) and raw.is_float and raw.colorspace_settings.name == "Non-Color"
    drop_result_images()
    assert_unchanged(before)


def test_operator_script_and_files_have_the_same_pictures(
    scene: bpy.types.Scene, weights: Path, tmp_path: Path
) -> None:
    run_small(reference=True, out=str(tmp_path))
    shown = {name: pixels_of(bpy.data.images[image_name("Eye", name)])[..., :3] for name in PICTURES}
    raw = pixels_of(bpy.data.images["PatchNet Eye priority"])[..., 0]
    view = ran(depth=7, size=(24, 16), light="two-lights", weights=weights, reference=True).views[0]
    np.testing.assert_array_equal(raw, view.priority)
    for name, picture in shown.items():
        np.testing.assert_allclose(picture, view.pictures[name], atol=0.51 / 255)
        written = pixels_in(tmp_path / "Eye" / f"{name}.png")[..., :3]
        np.testing.assert_allclose(written, picture, atol=1e-6)


def test_run_all_with_cycles(scene: bpy.types.Scene, tmp_path: Path, weights: Path) -> None:
    out = tmp_path / "new" / "out"
    before = scene_snapshot()
    assert bpy.ops.patchnet.run_all(max_samples=2, depth=5, size=(24, 16), out=str(out)) == {"FINISHED"}
    assert results.voxels_of(scene).light == "cycles"
    refinement = pixels_of(bpy.data.images["PatchNet Eye priority"])[..., 0]
    drop_result_images()
    assert_unchanged(before)
    assert {path.name for path in out.iterdir()} == {
        "Eye", "codes.safetensors", "octree.safetensors", "overview.png", "report.json",
    }  # fmt: skip
    assert {path.name for path in (out / "Eye").iterdir()} == FILES
    assert [path.name for path in (tmp_path).iterdir()] == ["new"]
    coded = load_codes(out / "codes.safetensors", load_octree(out / "octree.safetensors"), load_weights(weights))
    report = json.loads((out / "report.json").read_text())
    assert report["octree"]["depth"] == coded.octree.depth == 5
    assert report["octree"]["nodes"] == coded.octree.node_count
    assert report["octree"]["leaves"] == coded.octree.leaf_count
    assert report["octree"]["bytes"] == coded.octree.nbytes
    assert report["weights"]["hash"] == coded.weights.hash
    assert report["versions"]["blender"] == bpy.app.version_string
    assert all(seconds >= 0 for seconds in report["timings_s"].values())
    (frame,) = report["frames"]
    assert frame["camera"] == "Eye" and frame["size"] == [24, 16] and frame["budget"] == pytest.approx(0.3)
    assert not {"mse", "mse_unrefined", "predicted", "uniform"} & set(frame) and "mse" not in frame["refined"]
    assert frame["refined"]["samples"] == 64.0 and 10.0 < frame["refined"]["spent"] < 20.0
    image = bpy.data.images.load(str(out / "Eye" / "priority.exr"))
    assert image.is_float and tuple(image.size) == (24, 16)
    np.testing.assert_array_equal(pixels_of(image)[..., 0], refinement)


def test_the_reference_is_traced_where_it_is_asked_for(scene: bpy.types.Scene, tmp_path: Path) -> None:
    """And goes with its files and images when the next job has none."""
    out = tmp_path / "out"
    raw = image_name("Eye", "reference luminance")
    for wanted in (True, False):
        run_small(reference=wanted, out=str(out))
        assert {path.name for path in (out / "Eye").iterdir()} == FILES | (
            {f"{name}.png" for name in OF_REFERENCE} if wanted else set()
        )
        for name in OF_REFERENCE:
            assert (image_name("Eye", name) in bpy.data.images) == wanted
        assert (raw in bpy.data.images) == wanted
        result, (frame,) = results.voxels_of(scene), json.loads((out / "report.json").read_text())["frames"]
        assert (result.errors is not None) == (result.comparison is not None) == ("mse" in frame) == wanted
        if wanted:
            assert set(frame["mse"]) == set(STRATEGIES)
            assert all(frame["mse"]["optimal"] <= value <= frame["mse_unrefined"] for value in frame["mse"].values())
    assert bpy.ops.patchnet.compare(size=SMALL["size"]) == {"FINISHED"}
    assert results.voxels_of(scene).comparison is not None and raw in bpy.data.images
    run_small(reference=False, strategy="optimal")  # it ranks by the reference, so that is there
    assert raw in bpy.data.images and results.voxels_of(scene).comparison is None


def test_settings_of_the_scene_hold_unless_given(scene: bpy.types.Scene) -> None:
    scene.patchnet.resolution, scene.patchnet.depth = "DEPTH", 4
    bpy.ops.patchnet.voxelize()
    assert results.voxels_of(scene).octree.depth == 4
    bpy.ops.patchnet.voxelize(depth=5)
    assert results.voxels_of(scene).octree.depth == 5
    bpy.ops.patchnet.voxelize(voxel_size=0.25)
    assert results.voxels_of(scene).octree.grid.voxel_size_world == pytest.approx(0.25)
    assert scene.patchnet.depth == 4


def test_memory_is_freed(scene: bpy.types.Scene) -> None:
    bpy.ops.patchnet.voxelize(depth=4)
    assert bpy.ops.patchnet.clear_results() == {"FINISHED"}
    assert results.result_of(scene) is None
    bpy.ops.patchnet.voxelize(depth=4)
    build()
    assert not any(session.result for session in open_sessions())


def test_light_is_baked_on_what_was_voxelized(scene: bpy.types.Scene) -> None:
    bpy.ops.patchnet.voxelize(depth=4, scope="SELECTED")
    area = results.voxels_of(scene).octree.area_world[0]
    bpy.ops.patchnet.bake_light(light="two-lights")
    assert results.voxels_of(scene).octree.area_world[0] == area
    bpy.data.objects["Slab"].location.z += 3.0
    bpy.context.view_layer.update()
    with pytest.raises(RuntimeError, match="run Voxelize again"):
        bpy.ops.patchnet.bake_light(light="two-lights")


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"scope": "SELECTED"}, "No selected object has a surface"),
        ({"cameras": "Nobody"}, "no camera 'Nobody'"),
        ({"depth": 14}, "GiB"),
        ({"depth": 7, "voxel_size": 0.1}, "choose one of them"),
        ({"weights": "/nowhere/weights.safetensors"}, "does not exist"),
        ({"out": "//relative"}, "save the file first"),
    ],
)
def test_bad_input_changes_nothing(
    scene: bpy.types.Scene, settings: dict[str, object], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("patchnet.patchnet_addon.lod.memory.available_memory", lambda: 1 << 30)
    for item in scene.objects:
        item.select_set(False)
    before = scene_snapshot()
    with pytest.raises(RuntimeError, match=message):
        run_small(reference=True, **settings)
    assert_unchanged(before)
    assert results.result_of(scene) is None


def test_stopping_anywhere_leaves_nothing_behind(weights: Path, tmp_path: Path) -> None:
    """Neither files nor the daylight that a scene without light gets."""
    build(light=False)
    before = scene_snapshot()
    settings = JobSettings.of(depth=5, size=(16, 16), max_samples=2, weights=weights, out=tmp_path / "out")
    count = len(list(run_job(bpy.context, settings)))
    assert count > 8 and (tmp_path / "out").is_dir()
    for stop in range(0, count, max(1, count // 6)):
        steps = run_job(bpy.context, settings.changed(out=tmp_path / "stopped"))
        reports = list(itertools.islice(steps, stop + 1))
        steps.close()
        assert_unchanged(before)
        if len(reports) <= stop:  # it goes on with the pages of the one that was stopped before, and so has less to say
            assert stop > count // 2
            shutil.rmtree(tmp_path / "stopped")
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_images_of_the_person_are_left_alone() -> None:
    own = bpy.data.images.new("PatchNet Preview", 4, 4)
    ours = show_image("PatchNet Preview", np.zeros((3, 5), np.float32))
    assert ours != own and tuple(own.size) == (4, 4) and tuple(ours.size) == (5, 3)
    again = show_image("PatchNet Preview", np.ones((6, 5), np.float32))
    assert again == ours and tuple(again.size) == (5, 6)


def leaf_luminance(octree: Octree) -> np.ndarray:
    return octree.luminance[octree.child_mask == 0] / 65535.0


def assert_scaled(given: Octree, automatic: Octree) -> None:
    """`given` shows the light of `automatic` times a smaller exposure."""
    unclamped = leaf_luminance(automatic) < 0.999
    assert unclamped.any() and given.exposure < automatic.exposure
    scaled = leaf_luminance(automatic) * given.exposure / automatic.exposure
    np.testing.assert_allclose(leaf_luminance(given)[unclamped], scaled[unclamped], atol=2e-5)


def test_exposure_is_chosen_or_given_and_kept(scene: bpy.types.Scene) -> None:
    bpy.ops.patchnet.voxelize(depth=5)
    unlit = results.voxels_of(scene).octree
    bpy.ops.patchnet.bake_light(light="two-lights")
    automatic = results.voxels_of(scene).octree
    assert automatic.provenance["exposure"] == "automatic"
    scene.patchnet.exposure = 0.25
    bpy.ops.patchnet.bake_light(light="two-lights")
    given = results.voxels_of(scene).octree
    assert (given.exposure, given.provenance["exposure"]) == (0.25, "given")
    assert_scaled(given, automatic)
    bpy.ops.patchnet.voxelize(depth=5)
    again = results.voxels_of(scene).octree
    assert again.exposure == unlit.exposure and "exposure" not in again.provenance, "a colour is not exposed"
