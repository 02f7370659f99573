# SPDX-License-Identifier: GPL-3.0-or-later
"""Jobs use the look-ahead of the chosen weights."""

from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet.operators.pipeline.run import JobResult
from patchnet.tests.blender.job_scene import build, ran, random_weights

SIZE = (50, 30)
LENS_MM = 480.0  # a long lens, so that leaves are on levels below the coarsest


@pytest.fixture(scope="module")
def near(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file of untrained weights that look one level ahead."""
    return random_weights(tmp_path_factory.mktemp("near"), lookahead=1)


def fitted(weights: Path, **values: object) -> JobResult:
    build()
    bpy.context.scene.camera.data.lens = LENS_MM
    bpy.context.view_layer.update()
    return ran(light="two-lights", size=SIZE, weights=weights, **values)


def share_ahead(result: JobResult, lookahead: int) -> float:
    hits, octree = result.views[0].buffers.hits, result.coded.octree
    return float(octree.look_ahead(lookahead)[hits.node[hits.hit]].mean())


def test_depth_follows_the_weights(weights: Path, near: Path) -> None:
    two, one = fitted(weights), fitted(near)
    assert one.coded.octree.depth == two.coded.octree.depth - 1 > 8
    for result, lookahead in ((two, 2), (one, 1)):
        buffers = result.views[0].buffers
        assert (
            share_ahead(result, lookahead) == pytest.approx(buffers.lookahead_share) and buffers.lookahead_share >= 0.95
        )
        assert result.coded.weights.lookahead == lookahead
        assert result.coded.coded_count == result.coded.octree.look_ahead(lookahead).sum()
        assert np.isfinite(result.views[0].priority).all()
    assert share_ahead(one, 2) < 0.95


def test_a_given_depth_needs_no_weights(registered: None, tmp_path: Path) -> None:
    build()
    bpy.context.scene.patchnet.weights = str(tmp_path / "none.safetensors")
    assert bpy.ops.patchnet.voxelize(depth=5) == {"FINISHED"}
    with pytest.raises(RuntimeError, match=r"none\.safetensors"):
        bpy.ops.patchnet.voxelize(resolution="AUTO")
