# SPDX-License-Identifier: GPL-3.0-or-later
"""Strategies, budgets, errors and variance against their definitions (methods 3, 5, 7.23-7.25)."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.patchnet_addon.sampling.errors import mse_at
from patchnet.patchnet_addon.sampling.pixel_buffers import PixelBuffers, active_pixels
from patchnet.patchnet_addon.sampling.ranking import rank
from patchnet.patchnet_addon.sampling.refine import pixel_hash, refined_mask, refined_picture, refinement_order
from patchnet.patchnet_addon.sampling.registry import STRATEGIES, strategy
from patchnet.patchnet_addon.sampling.window_variance import window_variance
from patchnet.tests.references.small import window_variance_reference

BUDGETS = np.linspace(0, 1, 101)


def random_buffers(seed: int = 0, height: int = 17, width: int = 23, hits: float = 0.66) -> PixelBuffers:
    """A view of noise: every part is filled in; about a share `hits` of the pixels are hit."""
    rng = np.random.default_rng(seed)
    pixels = height * width
    hit = rng.random(pixels) < hits
    preview = np.where(hit, rng.random(pixels), 0.0).astype(np.float32)
    normal = rng.standard_normal((pixels, 3)).astype(np.float32)
    first = SimpleNamespace(
        height_px=height,
        width_px=width,
        hit=hit,
        luminance=preview,
        node=np.where(hit, 1, -1),
        level=rng.integers(5, 8, pixels).astype(np.int32),
        ratio=rng.uniform(0.5, 1, pixels).astype(np.float32),
        z_world=np.where(hit, rng.uniform(1, 2, pixels), np.inf).astype(np.float32),
        direction=normal[::-1],
    )

    def patch() -> SimpleNamespace:
        known = hit & (rng.random(pixels) < 0.9)
        return SimpleNamespace(
            coverage=np.where(known, rng.random(pixels), 1.0).astype(np.float32),
            luminance=np.where(known, rng.random(pixels), preview).astype(np.float32),
            look_ahead=known,
        )

    return PixelBuffers(
        hits=first,
        behind=rng.random(pixels).astype(np.float32),
        behind_hit=rng.random(pixels) < 0.5,
        fine=rng.random(pixels).astype(np.float32),
        fine_rays=rng.random((pixels, 4)).astype(np.float32),
        normal=normal,
        child_mask=rng.integers(0, 256, pixels).astype(np.uint8),
        cube_side_world=2.0,
        scene_luminance=0.4,
        prediction=patch(),
        exact=patch(),
        reference=np.clip(preview + rng.normal(0, 0.2, pixels), 0, 1).astype(np.float32),
    )


@pytest.mark.parametrize("name", STRATEGIES)
@given(seed=st.integers(0, 1000))
@settings(max_examples=10, deadline=None)
def test_curves(name: str, seed: int) -> None:
    buffers = random_buffers(seed)
    curve = mse_at(buffers, STRATEGIES[name].scores(buffers), BUDGETS)
    best = mse_at(buffers, STRATEGIES["optimal"].scores(buffers), BUDGETS)
    error = (buffers.preview.astype(float) - buffers.reference)[buffers.active] ** 2
    assert curve[0] == pytest.approx(error.mean(), rel=1e-12)
    assert curve[-1] == 0.0
    assert np.all(np.diff(curve) <= 0.0)
    assert np.all(best <= curve * (1 + 1e-12))


@pytest.mark.parametrize("name", STRATEGIES)
def test_mse_is_that_of_the_refined_picture(name: str) -> None:
    buffers = random_buffers(3)
    score = STRATEGIES[name].scores(buffers)
    assert score.dtype == np.float32 and score.shape == (17 * 23,)
    mask = refined_mask(buffers, refinement_order(buffers, score), 0.3)
    assert mask.sum() == round(0.3 * buffers.active.sum())
    assert not (mask & ~buffers.active).any()
    error = (refined_picture(buffers, mask).astype(float) - buffers.reference)[buffers.active] ** 2
    assert mse_at(buffers, score, [0.3])[0] == pytest.approx(error.mean(), rel=1e-12)


def test_paper_score_by_hand() -> None:
    buffers = random_buffers(1)
    score, behind = STRATEGIES["patchnet"].scores(buffers), STRATEGIES["patchnet-behind"].scores(buffers)
    for pixel in range(17 * 23):
        sigma, luminance = float(buffers.prediction.coverage[pixel]), float(buffers.prediction.luminance[pixel])
        own, back = float(buffers.preview[pixel]), float(buffers.behind[pixel])
        hit = bool(buffers.hit[pixel])
        assert score[pixel] == pytest.approx((abs(1 - sigma) + 5 * abs(own - luminance)) if hit else 0, abs=1e-6)
        expected = abs(own - (sigma * luminance + (1 - sigma) * back)) if hit else 0
        assert behind[pixel] == pytest.approx(expected, abs=1e-6)


def test_active_pixels_by_hand() -> None:
    hit = np.zeros((5, 6), bool)
    hit[0, 0] = hit[3, 4] = True
    expected = np.zeros_like(hit)
    expected[0:2, 0:2] = expected[2:5, 3:6] = True
    np.testing.assert_array_equal(active_pixels(hit), expected)


def test_urgency_follows_the_order() -> None:
    buffers = random_buffers(7)
    ranking = rank(STRATEGIES["patchnet-behind"], buffers, 0.4)
    amount = ranking.urgency(int(ranking.mask.sum()))
    assert amount.max() == 1.0 and not amount[~ranking.mask].any()
    expected = refined_mask(buffers, refinement_order(buffers, ranking.score), 0.4)
    np.testing.assert_array_equal(ranking.mask, expected)
    assert np.all(np.diff(amount[ranking.order]) <= 0)


def test_missing_part_is_named() -> None:
    buffers = random_buffers()
    with pytest.raises(SettingError, match="reference"):
        STRATEGIES["optimal"].scores(PixelBuffers(hits=buffers.hits))


@pytest.mark.parametrize("kinds", [1, 2, 7, 10_000])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_order_is_that_of_score_then_hash(kinds, dtype) -> None:
    """Whatever is equal: everything, much, little, or nothing."""
    buffers = random_buffers(3, 40, 60)
    rng = np.random.default_rng(kinds)
    score = (rng.integers(0, kinds, 40 * 60) / kinds).astype(dtype)
    for importance in (None, (rng.random(40 * 60) < 0.8).astype(np.float32)):
        weighed = replace(buffers, importance=importance)
        active = np.flatnonzero(buffers.active)
        urgency = score[active] if importance is None else (score * importance)[active]
        keys = [pixel_hash(len(score))[active], -urgency]
        keys += [] if importance is None else [importance[active] <= 0]
        np.testing.assert_array_equal(refinement_order(weighed, score), active[np.lexsort(keys)])


def test_empty_frame_has_no_error() -> None:
    hits = SimpleNamespace(height_px=4, width_px=4, hit=np.zeros(16, bool), luminance=np.zeros(16, np.float32))
    buffers = PixelBuffers(hits=hits, reference=np.zeros(16, np.float32))
    assert mse_at(buffers, np.zeros(16), [0.0, 0.5]).tolist() == [0.0, 0.0]
    assert buffers.lookahead_share is None


def test_an_expensive_renderer_takes_the_worst_pixels_after_those_that_come_first() -> None:
    buffers = random_buffers()
    importance = np.where(np.arange(len(buffers.preview)) % 5 == 0, 0.0, 1.0).astype(np.float32)
    ranking = rank(strategy("ss-variance"), replace(buffers, importance=importance), 0.3)
    nobody, first = np.zeros(len(importance), bool), np.zeros(len(importance), bool)
    active = buffers.active & (importance > 0.0)
    for budget in (0.0, 0.1, 0.37):
        chosen = ranking.chosen(nobody, budget)
        assert chosen.sum() == int(budget * len(importance)) and (chosen <= active).all()
        assert not chosen.any() or ranking.priority[chosen].min() >= ranking.priority[active & ~chosen].max()
    first[~buffers.active | (importance == 0.0)] = True
    few = ranking.chosen(first, 0.02)
    assert (few <= first).all() and few.sum() == int(0.02 * len(importance))
    assert ranking.chosen(first, 1.0).all()
    np.testing.assert_array_equal(ranking.chosen(nobody, 1.0), importance > 0.0)


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (7, 1), (2, 2), (3, 3), (5, 2), (9, 17), (40, 130)])
def test_windows_of_all_sizes(shape: tuple[int, int]) -> None:
    """The order of additions differs, nothing else: 1e-15 of numbers of at most 1."""
    picture = np.random.default_rng(sum(shape)).random(shape, np.float32)
    expected = window_variance_reference(picture)
    np.testing.assert_allclose(window_variance(picture), expected, rtol=1e-12, atol=1e-15)


def test_flat_pictures_have_none() -> None:
    assert not window_variance(np.full((6, 8), 0.7, np.float32)).any()
