# SPDX-License-Identifier: GPL-3.0-or-later
"""The world-space table against rays through child cubes, and strategies on a traced view (methods 3.8, 7.24)."""

import numpy as np
import pytest

from patchnet.patchnet_addon.codes.patch_rays import exact_prediction
from patchnet.patchnet_addon.network.harmonics import real_harmonics
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.sampling.errors import mse_at
from patchnet.patchnet_addon.sampling.registry import STRATEGIES
from patchnet.patchnet_addon.sampling.strategy import PREDICTION
from patchnet.patchnet_addon.sampling.trace import trace_view
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.tests.engine.octree_samples import random_octree
from patchnet.training.strategies.registry import EVALUATED
from patchnet.training.strategies.ws_lut import (
    DIRECTIONS,
    child_areas,
    child_error_table,
    child_errors,
    fibonacci_directions,
)

NEW = [name for name, one in EVALUATED.items() if name not in STRATEGIES and PREDICTION not in one.needs]


def rasterised_area(mask, direction, pixels=600):
    """Projected area of a mask's children by parallel rays against each cube, in sides of the voxel squared."""
    right = np.cross(direction, np.eye(3)[np.abs(direction).argmin()])
    right /= np.linalg.norm(right)
    across = ((np.arange(pixels) + 0.5) / pixels - 0.5) * 1.8  # wider than the diagonal of a cube
    u, v = np.meshgrid(across, across)
    origins = u[..., None] * right + v[..., None] * np.cross(direction, right)
    covered = np.zeros((pixels, pixels), bool)
    for child in range(8):
        if mask >> child & 1:
            low = np.array([child & 1, child >> 1 & 1, child >> 2]) / 2 - 0.5
            planes = np.stack([low - origins, low + 0.5 - origins]) / direction
            covered |= planes.min(0).max(-1) <= planes.max(0).min(-1)
    return covered.mean() * 1.8**2


@pytest.mark.parametrize("mask", [1, 3, 9, 22, 96, 129, 150, 127, 254, 255])
def test_projected_areas_by_rays(mask):
    """To the pixels that outlines cross: 5e-3 of a voxel's side squared at this resolution."""
    directions = np.array([[0.6, 0.48, 0.64], [-0.1, 0.3, 0.9], [0.05, -0.99, -0.12]])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    found = child_areas(directions)[mask]
    np.testing.assert_allclose(found, [rasterised_area(mask, direction) for direction in directions], atol=5e-3)


def test_table_of_child_masks():
    """Exact areas fit a little better than the rasterised ones of methods 3.8, whose residual was 0.026."""
    table, directions = child_error_table(), fibonacci_directions(DIRECTIONS)
    assert table.shape == (256, 9) and not table[[0, 255]].any()
    assert np.abs(table[:, 1:4]).max() < 1e-4  # the error is even in the direction
    errors = child_errors(directions)
    assert errors.min() > -1e-9 and errors.max() < 0.75 + 1e-9
    residual = np.maximum(table @ real_harmonics(directions, 2).T, 0) - errors
    assert np.sqrt((residual**2).mean()) == pytest.approx(0.024, abs=0.001)
    assert np.abs(residual).max() == pytest.approx(0.188, abs=0.002)


@pytest.fixture(scope="module")
def octree():
    return random_octree(seed=12, depth=6, count=900, adaptive=True)


@pytest.fixture(scope="module")
def traced(octree):
    """View from where rays stop at leaves and at inner voxels, and some miss."""
    camera = Camera.look_at(np.array([1.9, -0.6, 1.3]), np.full(3, 0.5), size_px=(29, 25))
    buffers = drain(trace_view(octree, camera, [EVALUATED[name] for name in NEW]))
    leaf = buffers.hit & (octree.child_mask[buffers.hits.node] == 0)
    assert leaf.any() and (~leaf & buffers.hit).any() and (buffers.active & ~buffers.hit).any()
    return buffers


def test_table_scores_pixel_by_pixel(octree, traced):
    scores = EVALUATED["ws-lut"].scores(traced)
    for pixel, node in enumerate(traced.hits.node):
        expected = 0.0
        if node >= 0 and octree.child_mask[node]:
            harmonics = real_harmonics(traced.hits.direction[pixel].astype(float), 2)
            expected = max(0.0, float(child_error_table()[octree.child_mask[node]] @ harmonics))
        assert scores[pixel] == pytest.approx(expected, abs=1e-6)
    assert scores.max() > 0.1


def test_exact_scores_one_level_ahead(octree, traced):
    exact = drain(exact_prediction(octree, traced.hits, 1))
    coverage = EVALUATED["ws-lut-coverage"].scores(traced)
    np.testing.assert_allclose(coverage, np.where(traced.hit, 1 - exact.coverage, 0), atol=1e-7)
    blind = ~traced.hit | (octree.child_mask[traced.hits.node] == 0)
    assert not coverage[blind].any() and coverage.any()


@pytest.mark.parametrize("name", NEW)
def test_scores_of_a_traced_view(name, traced):
    scores = EVALUATED[name].scores(traced)
    assert scores.dtype == np.float32 and np.isfinite(scores).all() and scores.min() >= 0 and scores.any()
    budgets = np.linspace(0, 1, 21)
    curve, best = (mse_at(traced, each.scores(traced), budgets) for each in (EVALUATED[name], EVALUATED["optimal"]))
    assert np.all(np.diff(curve) <= 0) and np.all(best <= curve * (1 + 1e-12))
