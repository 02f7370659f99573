# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples per pixel by priority: the allocation against its definition, and traced pictures."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.sampling.adaptive import AdaptivePicture, Pace
from patchnet.patchnet_addon.sampling.pixel_buffers import PixelBuffers
from patchnet.patchnet_addon.sampling.ranking import Ranking, rank
from patchnet.patchnet_addon.sampling.refined_picture import refined_view, samples_report
from patchnet.patchnet_addon.sampling.registry import STRATEGIES
from patchnet.patchnet_addon.sampling.sample_counts import (
    COUNTS,
    SIDES,
    refined_counts,
    sample_counts,
)
from patchnet.patchnet_addon.sampling.trace import trace_view
from patchnet.patchnet_addon.tracing.pixel_filter import BLACKMAN_HARRIS, BOX_FILTER, PixelFilter
from patchnet.patchnet_addon.tracing.supersample import supersample_pixels
from patchnet.tests.engine.octree_samples import random_octree
from patchnet.tests.engine.test_adaptive import camera, colored
from patchnet.tests.engine.test_sampling import random_buffers

CHOSEN = STRATEGIES["ss-variance"]
ERROR = np.array([1.0, 0.33, 0.055, 0.004, 0.0005, 0.0])  # methods 7.25b
BY_PRIORITY = np.array([0.75, 0.5, 0.25, 0.125, 0.0625, 0.0])
MEANS = [1.0, 1.01, 1.7, 4.0, 33.3, 300.0, 1023.0, 1024.0]


def falling(seed: int, count: int, zeros: float = 0.2) -> np.ndarray:
    """Priorities of several orders of magnitude, some of them equal, some 0."""
    rng = np.random.default_rng(seed)
    values = np.where(rng.random(count) < 0.5, 10 ** rng.uniform(-4, 0, count), rng.integers(1, 9, count) / 8)
    return np.sort(np.where(rng.random(count) < zeros, 0.0, values))[::-1].astype(np.float32)


def expected_errors(priorities: np.ndarray) -> np.ndarray:
    """(6, A): squared error of each pixel with each number of samples, as methods 7.25b expects it."""
    values = priorities.astype(np.float64)
    relative = values / values[values > 0].mean() if (values > 0).any() else values
    return ERROR[:, None] * (BY_PRIORITY[:, None] * relative + (1.0 - BY_PRIORITY[:, None]))


def upgrades(priorities: np.ndarray) -> list[tuple[float, int, int, int]]:
    """(less worth a sample, level, pixel, samples) of every upgrade, most worth first, equal ones in their order."""
    gain = np.diff(expected_errors(priorities), axis=0)
    each = [
        (round(gain[level, pixel] / cost, 15), level, pixel, int(cost))
        for level, cost in enumerate(np.diff(COUNTS))
        for pixel, value in enumerate(priorities)
        if value > 0
    ]
    return sorted(each)


def counts_reference(priorities: np.ndarray, mean: float, first: int = 0, last: int = 5) -> np.ndarray:
    """Upgrade by upgrade, in the order of their worth, each that still can be paid for and that follows the others.

    first, last: the levels that all pixels begin at, and that none goes beyond.
    """
    levels = np.full(len(priorities), first)
    spare = int(mean * len(priorities) * (1 + 1e-12)) - COUNTS[first] * len(priorities)
    for _, level, pixel, cost in upgrades(priorities):
        follows = levels[pixel] == level < last and (pixel == 0 or levels[pixel - 1] > level)
        if cost <= spare and follows:
            levels[pixel] += 1
            spare -= cost
    return COUNTS[levels]


@given(
    seed=st.integers(0, 10_000),
    count=st.integers(0, 40),
    mean=st.one_of(st.sampled_from(MEANS), st.floats(1, 1024), st.floats(1, 20)),
)
@settings(max_examples=200, deadline=None)
def test_against_one_upgrade_after_another(seed: int, count: int, mean: float) -> None:
    priorities = falling(seed, count)
    np.testing.assert_array_equal(sample_counts(priorities, mean), counts_reference(priorities, mean))


def test_extremes() -> None:
    priorities = falling(3, 200)
    assert (sample_counts(priorities, 1.0) == 1).all()
    np.testing.assert_array_equal(sample_counts(priorities, 1024.0), np.where(priorities > 0, 1024, 1))
    assert (sample_counts(np.zeros(9), 50.0) == 1).all() and sample_counts(np.zeros(0), 50.0).shape == (0,)
    alike = sample_counts(np.full(10, 0.3), 2.5)
    np.testing.assert_array_equal(alike, [4] * 5 + [1] * 5)
    not_numbers = np.array([np.inf, 1e38, 1e-45, np.nan], np.float32)
    with np.errstate(all="raise", under="ignore"):
        counts = sample_counts(not_numbers, 300.0)
    np.testing.assert_array_equal(counts, [256, 256, 256, 1])


@pytest.mark.parametrize("mean", [0.0, 0.99, 1024.5, -4.0, float("nan"), float("inf")])
def test_a_mean_outside_its_range(mean: float) -> None:
    with pytest.raises(SettingError, match=r"Samples per pixel .* is outside 1 to 1024: give the mean"):
        sample_counts(np.ones(3), mean)


def test_scores_of_zero_may_be_wrong_and_importance_of_zero_never_matters() -> None:
    """A pixel without look-ahead has a score of 0: it gets its samples after all that have a score."""
    buffers = random_buffers(4)
    score = np.zeros(len(buffers.preview), np.float32)
    score[np.flatnonzero(buffers.active)[:50]] = 0.5
    weights = (np.arange(len(score)) % 5 > 0).astype(np.float32)
    buffers = replace(buffers, importance=weights)
    zero = replace(CHOSEN, score=lambda _: score)
    most = rank(zero, buffers, 0.3).samples(1024.0)
    np.testing.assert_array_equal(most, np.where(buffers.active & (weights > 0), 1024, 1))
    some = rank(zero, buffers, 0.3).samples(3.0)
    assert some[(score > 0) & (weights > 0)].min() > 1 and (some[weights == 0] == 1).all()
    assert set(some[buffers.active & (score == 0)].tolist()) == {1, 4}


def view(
    with_color: bool = False, pixel_filter: PixelFilter = BOX_FILTER
) -> tuple[AdaptivePicture, Ranking, PixelBuffers]:
    """A traced picture, and the same view with its reference."""
    octree = colored(random_octree()) if with_color else random_octree()
    picture = AdaptivePicture(octree, camera(), CHOSEN, pixel_filter=pixel_filter)
    drain(picture.trace())
    buffers = drain(trace_view(octree, camera(), [CHOSEN]))
    return picture, rank(CHOSEN, buffers, 0.3), buffers


@pytest.mark.parametrize("with_color", [False, True])
def test_pixels_are_traced_with_their_samples(with_color: bool) -> None:
    picture, ranking, buffers = view(with_color)
    drain(picture.refine(0.0, pace=Pace(batch_rays=3000), spp=9.0))
    samples = ranking.samples(9.0)
    np.testing.assert_array_equal(picture.samples, samples)
    assert set(samples.tolist()) == {1, 4, 16}
    for side in SIDES:
        pixels = np.flatnonzero(samples == side**2)
        if side == 1:
            seen = buffers.preview[pixels, None] if buffers.preview_color is None else buffers.preview_color[pixels]
            np.testing.assert_allclose(picture.values[pixels, :3], np.broadcast_to(seen, (len(pixels), 3)), atol=1e-7)
        else:
            means = supersample_pixels(picture.octree, picture.camera, pixels, side)
            np.testing.assert_allclose(picture.values[pixels, :3], means.colors, atol=1e-7)
            np.testing.assert_allclose(picture.values[pixels, 3], means.coverage, atol=1e-7)


@pytest.mark.parametrize("pixel_filter", [BOX_FILTER, PixelFilter(BLACKMAN_HARRIS, 1.5)], ids=str)
@pytest.mark.parametrize("with_color", [False, True])
def test_the_picture_of_a_job_is_that_of_a_render(with_color: bool, pixel_filter: PixelFilter) -> None:
    picture, ranking, buffers = view(with_color, pixel_filter)
    drain(picture.refine(0.0, spp=9.0))
    pace, samples = Pace(batch_rays=3000), ranking.samples(9.0)
    refined = drain(refined_view(picture.octree, picture.camera, ranking, samples, pixel_filter, pace=pace))
    np.testing.assert_array_equal(refined.samples, picture.samples)
    assert refined.refined_count == np.count_nonzero(picture.samples > 1)
    np.testing.assert_array_equal(picture.values[:, :3], refined.colors)
    np.testing.assert_array_equal(picture.values[:, 3], refined.alpha)
    plain = drain(refined_view(picture.octree, picture.camera, ranking, samples))
    np.testing.assert_array_equal(refined.luminance, plain.luminance)
    if not with_color:
        np.testing.assert_allclose(plain.colors[:, 0], plain.luminance, atol=1e-7)
    assert not np.shares_memory(refined.luminance, buffers.preview)


def test_figures_of_a_report() -> None:
    picture, ranking, buffers = view()
    refined = drain(refined_view(picture.octree, picture.camera, ranking, ranking.samples(9.0)))
    found = samples_report(ranking, refined)
    active = buffers.active
    assert found["spent"] == pytest.approx(refined.samples[active].mean())
    assert sum(found["pixels"].values()) == active.sum() and list(found["pixels"]) == [str(count) for count in COUNTS]
    error = (refined.luminance.astype(float) - buffers.reference)[active] ** 2
    assert found["mse"] == pytest.approx(error.mean(), rel=1e-12)
    share = refined.samples[refined.samples > 1].sum() / 1024 / active.sum()
    shared = rank(CHOSEN, buffers, share)
    by_share = drain(refined_view(picture.octree, picture.camera, shared, shared.refined_samples(1024.0)))
    error = (by_share.luminance.astype(float) - buffers.reference)[active] ** 2
    assert found["mse_of_share"] == pytest.approx(error.mean(), rel=1e-6)
    blind = rank(CHOSEN, replace(buffers, reference=None), 0.3)
    assert samples_report(blind, refined) == {name: found[name] for name in ("spent", "pixels")}


@given(
    seed=st.integers(0, 10_000),
    count=st.integers(0, 40),
    mean=st.one_of(st.sampled_from([16.0, 64.0, 256.0, 256.5, 1024.0]), st.floats(16, 1024), st.floats(16, 80)),
)
@settings(max_examples=200, deadline=None)
def test_refined_pixels_against_one_upgrade_after_another(seed: int, count: int, mean: float) -> None:
    """From 16 samples on, to 256 or, for a larger mean, 1,024."""
    priorities = falling(seed, count, zeros=0.0)
    expected = counts_reference(priorities, mean, first=2, last=4 if mean <= 256 else 5)
    np.testing.assert_array_equal(refined_counts(priorities, mean), expected)


def test_a_share_is_refined_alike_by_jobs_and_renders() -> None:
    picture, ranking, buffers = view()
    drain(picture.refine(0.3, refined=64.0))
    refined = drain(refined_view(picture.octree, picture.camera, ranking, ranking.refined_samples(64.0)))
    np.testing.assert_array_equal(refined.samples, picture.samples)
    np.testing.assert_allclose(refined.luminance, picture.values[:, 0], atol=1e-7)
    np.testing.assert_array_equal(refined.samples > 1, ranking.mask)
    every = drain(refined_view(picture.octree, picture.camera, ranking, ranking.refined_samples(1024.0)))
    np.testing.assert_array_equal(every.luminance, np.where(ranking.mask, buffers.reference, buffers.preview))


@pytest.mark.parametrize("mean", [2.0, 8.0, 32.0])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_less_error_is_left_than_by_a_share_of_as_many_rays(seed: int, mean: float) -> None:
    octree, eye = random_octree(seed, depth=7, count=4000), camera(46, 34)
    buffers = drain(trace_view(octree, eye, [CHOSEN]))
    ranking = rank(CHOSEN, buffers, 0.3)
    found = samples_report(ranking, drain(refined_view(octree, eye, ranking, ranking.samples(mean))))
    assert found["mse"] < 0.8 * found["mse_of_share"]
