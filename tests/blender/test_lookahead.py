# SPDX-License-Identifier: GPL-3.0-or-later
"""Jobs look as far ahead as the weights that are chosen: depths, leaves, estimates, codes and pictures."""

from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet.operators.pipeline.estimate import estimate_job
from patchnet.operators.pipeline.lit_octree import build_lit_octree
from patchnet.operators.pipeline.run import JobResult, run_job
from patchnet.operators.scene.cameras import tracing_camera
from patchnet.operators.settings.job_settings import JobSettings
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.runtime.stage_clock import StageClock
from patchnet.patchnet_addon.tracing.render import first_hits
from patchnet.tests.blender.job_scene import build, random_weights

SIZE = (96, 64)


@pytest.fixture(scope="module")
def near(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file of untrained weights that look one level ahead."""
    return random_weights(tmp_path_factory.mktemp("near"), lookahead=1)


def ran(weights: Path, **values: object) -> JobResult:
    build()
    return drain(run_job(bpy.context, JobSettings.of(light="two-lights", size=SIZE, weights=weights, **values)))


def share_ahead(result: JobResult, lookahead: int) -> float:
    hits, octree = result.views[0].buffers.hits, result.coded.octree
    return float(octree.look_ahead(lookahead)[hits.node[hits.hit]].mean())


def test_depth_follows_the_weights(weights: Path, near: Path) -> None:
    two, one = ran(weights), ran(near)
    assert one.coded.octree.depth == two.coded.octree.depth - 1 > 5
    for result, lookahead in ((two, 2), (one, 1)):
        buffers = result.views[0].buffers
        assert (
            share_ahead(result, lookahead) == pytest.approx(buffers.lookahead_share) and buffers.lookahead_share >= 0.95
        )
        assert result.coded.weights.lookahead == lookahead
        assert result.coded.coded_count == result.coded.octree.look_ahead(lookahead).sum()
        assert np.isfinite(result.views[0].priority).all()
    assert share_ahead(one, 2) < 0.95


def test_leaves_follow_the_weights(weights: Path, near: Path) -> None:
    build()
    size = (120, 80)
    bpy.data.cameras["Eye"].lens = 200.0  # for leaves below the level of blocks, of which a narrow slab has few
    bpy.data.objects["Slab"].scale = (0.25, 1.0, 0.25)
    bpy.context.view_layer.update()
    camera = tracing_camera(bpy.context.scene.camera, bpy.context.scene, size)
    octrees = []
    for path, lookahead in ((weights, 2), (near, 1)):
        settings = JobSettings.of(light="two-lights", fit=True, size=size, weights=path)
        octree = drain(build_lit_octree(bpy.context, settings, StageClock())).octree
        hits = first_hits(octree, camera)
        assert octree.look_ahead(lookahead)[hits.node[hits.hit]].mean() > 0.98
        octrees.append(octree)
    two, one = octrees
    assert one.leaf_count < two.leaf_count and one.depth == two.depth - 1
    assert one.look_ahead(2)[hits.node[hits.hit]].mean() < 0.5


def test_a_given_depth_needs_no_weights(registered: None, tmp_path: Path) -> None:
    build()
    bpy.context.scene.patchnet.weights = str(tmp_path / "none.safetensors")
    assert bpy.ops.patchnet.voxelize(depth=5) == {"FINISHED"}
    with pytest.raises(RuntimeError, match=r"none\.safetensors"):
        bpy.ops.patchnet.voxelize(resolution="AUTO")


def test_estimate_follows_the_weights(weights: Path, near: Path) -> None:
    build()

    def estimated(path: Path, **values: object):
        return drain(estimate_job(bpy.context, JobSettings.of(size=SIZE, light="two-lights", weights=path, **values)))

    two, one = estimated(weights), estimated(near)
    assert one.depth == two.depth - 1 and one.lookahead_share == two.lookahead_share >= 0.95
    same = estimated(weights, depth=one.depth), estimated(near, depth=one.depth)
    assert same[0].lookahead_share < same[1].lookahead_share
    assert same[1].codes_bytes == pytest.approx(4 * same[0].codes_bytes, abs=4)
