# SPDX-License-Identifier: GPL-3.0-or-later
"""Predicted pictures: luminance, colour, alpha, priority and refinement by definition."""

from dataclasses import replace

import numpy as np
import pytest

from patchnet.patchnet_addon.codes.coded_octree import CodedOctree
from patchnet.patchnet_addon.codes.encode import encode_octree
from patchnet.patchnet_addon.codes.prediction import Prediction
from patchnet.patchnet_addon.network.weights import Weights
from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.sampling.adaptive import AdaptivePicture, Pace
from patchnet.patchnet_addon.sampling.errors import mse_at
from patchnet.patchnet_addon.sampling.patchnet_behind import neighbour_difference, remaining_error
from patchnet.patchnet_addon.sampling.pixel_buffers import PixelBuffers
from patchnet.patchnet_addon.sampling.predicted import PREDICTED, PREVIEW, expected_luminance
from patchnet.patchnet_addon.sampling.ranking import rank
from patchnet.patchnet_addon.sampling.refine import refined_picture
from patchnet.patchnet_addon.sampling.registry import STRATEGIES
from patchnet.patchnet_addon.sampling.trace import trace_view
from patchnet.patchnet_addon.surface.chroma import REC709
from patchnet.tests.engine.octree_samples import random_octree
from patchnet.tests.engine.test_adaptive import camera, colored

CHOSEN = STRATEGIES["patchnet-behind"]


@pytest.fixture(scope="module")
def coded() -> CodedOctree:
    """Octree in colour with untrained codes, whose predictions are anything."""
    octree = colored(random_octree(seed=8, depth=6, count=2500, adaptive=True))
    return drain(encode_octree(octree, Weights.random(seed=9, bias=0.1)))


@pytest.fixture(scope="module")
def view(coded: CodedOctree) -> PixelBuffers:
    """View of it that shows what is predicted: hits with look-ahead and without, and misses."""
    buffers = drain(trace_view(coded.octree, camera(), [CHOSEN], coded=coded, unrefined=PREDICTED))
    assert buffers.prediction is not None
    ahead = buffers.prediction.look_ahead
    assert ahead.sum() > 20 and (buffers.hit & ~ahead).sum() > 20 and (~buffers.hit).sum() > 20
    return buffers


def test_luminance_by_hand() -> None:
    patch = Prediction(np.float32([0.25, 1.0]), np.float32([0.8, 0.3]), np.array([True, False]))
    np.testing.assert_allclose(expected_luminance(patch, np.float32([0.4, 0.9])), [0.2 + 0.3, 0.3], rtol=1e-6)


def test_it_is_the_preview_where_nothing_is_known(view: PixelBuffers) -> None:
    unknown = ~view.prediction.look_ahead
    np.testing.assert_array_equal(view.predicted[unknown], view.preview[unknown])
    np.testing.assert_array_equal(view.predicted_color[unknown], view.preview_color[unknown])
    known = view.prediction.look_ahead
    assert np.mean(view.predicted[known] != view.preview[known]) > 0.9
    np.testing.assert_array_equal(view.shown, view.predicted)
    np.testing.assert_array_equal(replace(view, unrefined=PREVIEW).shown, view.preview)


def test_colours_have_the_predicted_luminance(view: PixelBuffers) -> None:
    np.testing.assert_allclose(view.predicted_color @ REC709, view.predicted, atol=2e-6)
    alone = view.prediction.look_ahead & (view.preview > 0.01) & (view.behind < 1e-6)  # nothing mixes with the voxel
    assert alone.sum() > 5
    ours, voxels = view.predicted_color[alone], view.preview_color[alone]
    sums = ours.sum(axis=1, keepdims=True), voxels.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(ours * sums[1], voxels * sums[0], atol=1e-5)


def test_alpha_is_what_is_met_in_the_patch_or_behind(view: PixelBuffers) -> None:
    coverage = view.prediction.coverage
    np.testing.assert_array_equal(view.shown_alpha[~view.hit], 0.0)
    np.testing.assert_array_equal(view.shown_alpha[view.hit & view.behind_hit], 1.0)
    edge = view.hit & ~view.behind_hit
    np.testing.assert_allclose(view.shown_alpha[edge], coverage[edge], rtol=1e-6)
    assert (view.shown_alpha[edge] < 1).any() and (view.behind[~view.behind_hit] == 0).all()
    np.testing.assert_array_equal(replace(view, unrefined=PREVIEW).shown_alpha, view.hit)


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (4, 1), (7, 6)])
def test_neighbour_difference_pixel_by_pixel(shape: tuple[int, int]) -> None:
    picture = np.random.default_rng(3).random(shape).astype(np.float32)
    found = neighbour_difference(picture)
    for row in range(shape[0]):
        for column in range(shape[1]):
            around = picture[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2].astype(float)
            wanted = np.mean((around - float(picture[row, column])) ** 2)
            assert found[row, column] == pytest.approx(wanted, rel=1e-12)


def test_priority_by_definition(view: PixelBuffers) -> None:
    score = CHOSEN.scores(view)
    np.testing.assert_array_equal(score, remaining_error(view))
    around = neighbour_difference(view.picture(view.predicted)).ravel()
    sample = np.where(view.hit, view.predicted - view.fine, 0.0)
    np.testing.assert_allclose(score, np.sqrt(sample**2 + around), rtol=1e-5, atol=1e-7)
    assert score[view.active & ~view.hit].max() > 0, "beside silhouettes, where no ray met anything, it says something"


def test_errors_are_those_of_the_shown_picture(view: PixelBuffers) -> None:
    active = view.active
    error = (view.predicted.astype(float) - view.reference)[active] ** 2
    for name in ("patchnet-behind", "optimal", "ss-variance", "random"):
        score = STRATEGIES[name].scores(view)
        left = mse_at(view, score, [0.0, 0.3, 1.0])
        best = mse_at(view, STRATEGIES["optimal"].scores(view), [0.3])[0]
        assert left[0] == pytest.approx(error.mean()) and left[2] == 0.0 and left[1] >= best - 1e-12
    mask = rank(CHOSEN, view, 0.3).mask
    np.testing.assert_array_equal(refined_picture(view, mask), np.where(mask, view.reference, view.predicted))


def test_a_picture_in_bands_is_the_picture_at_once(coded: CodedOctree, view: PixelBuffers) -> None:
    picture = AdaptivePicture(coded.octree, camera(), CHOSEN, coded, unrefined=PREDICTED)
    drain(picture.trace(Pace(band_pixels=50)))
    np.testing.assert_allclose(picture.values[:, :3], view.predicted_color, atol=1e-6)
    np.testing.assert_allclose(picture.values[:, 3], view.shown_alpha, atol=1e-6)
    np.testing.assert_allclose(picture.ranking.score, CHOSEN.scores(view), atol=1e-6)
    drain(picture.refine(0.3))
    mask = rank(CHOSEN, view, 0.3).mask
    np.testing.assert_array_equal(picture.samples, np.where(mask, 1024, 1))
    colors = np.where(mask[:, None], view.reference_color, view.predicted_color)
    np.testing.assert_allclose(picture.values[:, :3], colors, atol=1e-5)


@pytest.mark.parametrize("mean", [1.0, 3.0, 9.0, 100.0])
def test_a_predicted_pixel_gets_no_four_samples(view: PixelBuffers, mean: float) -> None:
    """They would be no better than what it shows already."""
    ranking = rank(CHOSEN, view, 0.3)
    samples = ranking.samples(mean)
    assert set(samples.tolist()) <= {1, 16, 64, 256, 1024} and samples[view.active].mean() <= mean
    assert (np.diff(samples[ranking.order]) <= 0).all() and (mean == 1.0) == (samples.max() == 1)


def test_what_is_missing_is_named(coded: CodedOctree) -> None:
    with pytest.raises(SettingError, match="precompute them first"):
        drain(trace_view(coded.octree, camera(), [STRATEGIES["random"]], unrefined=PREDICTED))
