# SPDX-License-Identifier: GPL-3.0-or-later
"""Importance: resizing, and its effect on order, budget and errors."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from patchnet.patchnet_addon.sampling.errors import mse_at, squared_error
from patchnet.patchnet_addon.sampling.importance import PixelRect, beside_hits, picture_weights
from patchnet.patchnet_addon.sampling.ranking import rank
from patchnet.patchnet_addon.sampling.refine import priority, refinable, refined_mask, refinement_order
from patchnet.patchnet_addon.sampling.registry import STRATEGIES
from patchnet.tests.engine.test_sampling import random_buffers


@given(
    before=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    after=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    seed=st.integers(0, 99),
)
@settings(max_examples=50, deadline=None)
def test_resizing_against_its_definition(before: tuple[int, int], after: tuple[int, int], seed: int) -> None:
    values = np.random.default_rng(seed).random(before).astype(np.float32)
    resized = picture_weights(values, *after).reshape(after)
    assert resized.min() >= values.min() - 1e-6 and resized.max() <= values.max() + 1e-6
    row, column = after[0] // 2, after[1] // 2
    shares = [one_axis(b, a, index) for b, a, index in zip(before, after, (row, column), strict=True)]
    expected = sum(shares[0][y] * shares[1][x] * values[y, x] for y in shares[0] for x in shares[1])
    assert resized[row, column] == pytest.approx(expected, abs=1e-5)


def one_axis(before: int, after: int, index: int) -> dict[int, float]:
    """Shares of the painted pixels in one pixel of the buffers, pixel by pixel."""
    scale = before / after
    centre = (index + 0.5) * scale - 0.5
    if scale <= 1:
        centre = min(max(centre, 0.0), before - 1.0)
    shares = {k: max(0.0, 1.0 - abs(k - centre) / max(scale, 1.0)) for k in range(before)}
    total = sum(shares.values())
    return {k: share / total for k, share in shares.items() if share}


def test_thin_strokes_and_bad_values() -> None:
    stroke = np.zeros((64, 64))
    stroke[:, 20] = 1.0
    assert picture_weights(stroke, 16, 16).reshape(16, 16)[:, 4:6].max(axis=1).min() > 0.1
    assert picture_weights(np.array([[np.nan, 7.0, -3.0]]), 1, 3).tolist() == [0.0, 1.0, 0.0]


def test_beside_hits() -> None:
    weights = np.array([[0.5, 9.0, 9.0, 9.0], [0.2, 9.0, 9.0, 9.0]], np.float32)
    hit = np.array([[True, False, False, False], [True, False, False, False]])
    expected = [[0.5, 0.5, 0.0, 0.0], [0.2, 0.5, 0.0, 0.0]]
    np.testing.assert_allclose(beside_hits(weights, hit), expected)


@pytest.mark.parametrize("budget", [0.0, 0.1, 0.5, 1.0])
def test_weights_rank_and_zero_is_never_refined(budget: float) -> None:
    buffers = random_buffers()
    rng = np.random.default_rng(2)
    weights = np.where(rng.random(len(buffers.preview)) < 0.4, 0.0, rng.random(len(buffers.preview))).astype(np.float32)
    buffers = replace(buffers, importance=weights)
    score = rng.random(len(buffers.preview)).astype(np.float32)
    mask = refined_mask(buffers, refinement_order(buffers, score), budget)
    paid = min(round(budget * np.count_nonzero(buffers.active)), refinable(buffers))
    assert mask.sum() == paid and not mask[weights == 0].any() and not mask[~buffers.active].any()
    left_out = buffers.active & ~mask & (weights > 0)
    if mask.any() and left_out.any():
        assert (score * weights)[mask].min() >= (score * weights)[left_out].max()
    expected = squared_error(buffers)[buffers.active & ~mask].sum() / np.count_nonzero(buffers.active)
    assert mse_at(buffers, score, [budget])[0] == pytest.approx(expected)
    given = replace(STRATEGIES["random"], score=lambda _: score)
    shown = rank(given, buffers, budget).urgency(int(mask.sum()))
    np.testing.assert_array_equal(shown > 0, mask & (priority(buffers, score) > 0))


def test_a_place_that_reaches_beyond_the_frame() -> None:
    values = np.random.default_rng(5).random((9, 7))
    whole = picture_weights(values, 20, 30).reshape(20, 30)
    part = picture_weights(values, 8, 11, PixelRect(-4, -3, 30, 20)).reshape(8, 11)
    np.testing.assert_allclose(part, whole[3:11, 4:15], atol=1e-6)
