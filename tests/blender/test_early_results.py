# SPDX-License-Identifier: GPL-3.0-or-later
"""Results of Preview Selection after each round of its light, as in a window: kept, shown, and refined further."""

import shutil
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from patchnet.operators import overlay
from patchnet.operators.jobs.job_operator import job_in_window
from patchnet.operators.jobs.job_window import JobDisplay
from patchnet.operators.pipeline import lit_octree
from patchnet.operators.render_engine.coarse_light import COARSE
from patchnet.operators.render_engine.viewport import Viewport
from patchnet.operators.run_all import PATCHNET_OT_run_all
from patchnet.operators.session import octree_cache, results
from patchnet.operators.session.scene_result import SceneResult
from patchnet.operators.session.scene_session import session_of
from patchnet.operators.session.shown_view import HEATMAP, REFINED
from patchnet.operators.settings.job_settings import TABLE, JobSettings
from patchnet.operators.ui.main import PATCHNET_PT_main
from patchnet.operators.ui.stages import PATCHNET_PT_light
from patchnet.patchnet_addon.export.fine_light import FINE_LIGHT, LIGHT_NOISE
from patchnet.patchnet_addon.runtime.progress import Steps, drain
from patchnet.tests.blender.drawn import drawn
from patchnet.tests.blender.job_scene import SMALL

# Three rounds, 4, 12 and 48; without a filter, which leaves so little noise that it is hard to tell in a small scene.
NOISY = {"noise_threshold": 0.001, "max_samples": 64, "denoise": False, "reference": True, **SMALL}


class Job:
    """Stands in for the operator, which Blender alone can make, while it runs in a window."""

    bl_label = PATCHNET_OT_run_all.bl_label
    _file, _noise, _goes_on = None, "", False
    _stopped = PATCHNET_OT_run_all._stopped

    def __init__(self) -> None:
        self.told: list[str] = []
        self.changes: dict[str, object] = {}

    def report(self, _kind: set[str], text: str) -> None:
        self.told.append(text)

    def steps(self) -> Steps[str]:
        settings = JobSettings.of(weights=Path(bpy.context.scene.patchnet.weights), **NOISY | self.changes)
        return PATCHNET_OT_run_all.steps(self, bpy.context, settings)


@pytest.fixture
def job(scene: bpy.types.Scene, cache: Path, monkeypatch: pytest.MonkeyPatch) -> Job:
    """A job in a window, and a cache folder of its own that keeps octrees."""
    monkeypatch.setenv("PATCHNET_CACHE", str(cache))
    monkeypatch.setenv("PATCHNET_KEEP", "1")
    for name, value in NOISY.items():
        if name in TABLE:
            setattr(scene.patchnet, name, value)
    scene.patchnet.resolution = "DEPTH"
    window = SimpleNamespace(app=SimpleNamespace(background=False), data=bpy.data, context=bpy.context)
    monkeypatch.setattr(overlay, "bpy", window)
    made = Job()
    monkeypatch.setattr(job_in_window(), "operator", made)
    monkeypatch.setattr(job_in_window(), "display", JobDisplay(made.bl_label))
    return made


def until_kept(steps: Steps[str]) -> SceneResult:
    """Pull steps until the scene has a result."""
    for _ in steps:
        if (found := results.result_of(bpy.context.scene)) is not None:
            return found
    raise AssertionError("the job ended without an early result")


def images() -> set[str]:
    return {image.name for image in bpy.data.images if "patchnet_result" in image}


@pytest.mark.parametrize(("clock", "shown"), [(range(9), 2), ([0, 1, 9, 10, 11], 1)], ids=["quick", "slow"])
def test_each_round_is_kept_and_shown_unless_showing_takes_longer(
    job: Job, scene: bpy.types.Scene, cache: Path, monkeypatch: pytest.MonkeyPatch, clock: Sequence[int], shown: int
) -> None:
    monkeypatch.setattr(lit_octree, "time", SimpleNamespace(perf_counter=iter(clock).__next__))
    seen: list[SceneResult] = []
    for _ in job.steps():
        found = results.result_of(scene)
        if found is not None and not (seen and found is seen[-1]):
            seen.append(found)
            assert found.unfinished and found.coded is not None and found.errors is None and images()
            assert any("is being refined" in text for text in drawn(PATCHNET_PT_main))
            assert not list((cache / "octrees").glob("*")), "none is written"
    final = results.voxels_of(scene)
    noise = [each.octree.provenance[LIGHT_NOISE] for each in (*seen, final)]
    assert len(seen) == shown and noise == sorted(noise, reverse=True) and noise[-1] < noise[0]
    assert not final.unfinished and final.comparison is not None and list((cache / "octrees").glob("*"))
    assert not any("Light of noise" in text for text in drawn(PATCHNET_PT_main))
    assert any(text.startswith("Fine light on ") for text in drawn(PATCHNET_PT_light))
    assert final.octree.provenance[FINE_LIGHT] < 1.0


def test_a_stopped_job_leaves_its_last_round_and_goes_on(
    job: Job, scene: bpy.types.Scene, light_of_its_own: Path, bakes: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    steps = job.steps()
    left = until_kept(steps)
    steps.close()
    monkeypatch.setattr(job_in_window(), "display", None)
    (view,) = session_of(scene).views.values()
    assert results.voxels_of(scene) is left and left.unfinished and left.lookahead_share is not None and images()
    assert view.octree() is left.octree and view.has(HEATMAP) and view.has(REFINED)
    noise = f"Light of noise {job._noise}"
    assert job._stopped() == f"Stopped. The pictures have l{noise[1:]}: press again to refine it."
    assert f"{noise}: press Preview Selection again to refine it" in drawn(PATCHNET_PT_main)
    assert bpy.ops.patchnet.render_preview(size=(24, 16)) == {"FINISHED"}
    assert bpy.ops.patchnet.precompute_codes() == {"FINISHED"}
    assert results.voxels_of(scene).unfinished and octree_cache.found_on_disk(scene) is None
    assert len(bakes) > 0
    drain(job.steps())
    resumed, calls = results.voxels_of(scene), len(bakes)
    assert not resumed.unfinished and octree_cache.found_on_disk(scene) is not None
    monkeypatch.setenv("PATCHNET_KEEP", "0")
    bpy.ops.patchnet.clear_results()
    shutil.rmtree(light_of_its_own / "bakes")
    drain(job.steps())
    whole = results.voxels_of(scene)
    assert len(bakes) == 2 * calls, "no light was baked twice before"
    for name in ("luminance", "normal", "child_mask", "side_light"):
        np.testing.assert_array_equal(getattr(resumed.octree, name), getattr(whole.octree, name))
    np.testing.assert_array_equal(resumed.coded.codes, whole.coded.codes)


def test_a_job_that_refines_further_shows_nothing_noisier(
    job: Job, scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Finished light stays until there is better light, even if the job is stopped."""
    monkeypatch.setattr(lit_octree, "time", SimpleNamespace(perf_counter=iter(range(99)).__next__))
    drain(job.steps())
    before = results.voxels_of(scene)
    job.changes = {"max_samples": 1024}
    seen = [before, *(results.voxels_of(scene) for _ in job.steps()), results.voxels_of(scene)]
    seen = [found for found, last in zip(seen[1:], seen, strict=False) if found is not last]
    noise = [each.octree.provenance[LIGHT_NOISE] for each in seen]
    assert len(seen) == 2 and before.octree.provenance[LIGHT_NOISE] > noise[0] > noise[1]


def test_nobody_looks_in_background(job: Job, scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(job_in_window(), "operator", None)
    assert all(results.result_of(scene) is None for _ in job.steps())
    assert not results.voxels_of(scene).unfinished and job._noise == ""


def test_a_viewport_says_where_light_is_coarse(job: Job, scene: bpy.types.Scene) -> None:
    """Once it rests, unless it looks through a camera of the bake or light is fine everywhere."""
    drain(job.steps())
    result, said = results.voxels_of(scene), []
    engine = SimpleNamespace(update_stats=lambda _title, text: said.append(text))

    def told(perspective: str, *, rests: bool = True) -> bool:
        context = SimpleNamespace(scene=scene, region_data=SimpleNamespace(view_perspective=perspective))
        context.space_data = SimpleNamespace(use_local_camera=False, camera=None)
        Viewport()._say(engine, context, "Done", result, rests=rests)
        assert said[-1] in ("Done", f"Done, {COARSE}")
        return said[-1] != "Done"

    assert told("PERSP") and not told("PERSP", rests=False) and not told("CAMERA")
    scene.camera.location.x += 0.5
    bpy.context.view_layer.update()
    assert told("CAMERA")
    result.octree.provenance[FINE_LIGHT] = 1.0
    assert not told("PERSP") and not told("CAMERA")
