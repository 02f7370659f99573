# SPDX-License-Identifier: GPL-3.0-or-later
"""Curves over budgets against composed pictures, pixel by pixel (methods 5, 7.25)."""

import numpy as np
import pytest

from patchnet.patchnet_addon.sampling.refine import refined_mask, refined_picture, refinement_order
from patchnet.tests.engine.test_sampling import random_buffers
from patchnet.tests.training.frame_samples import NAMES, scores_of, track_of
from patchnet.training.evaluation.curves import (
    BUDGETS,
    area,
    crossing,
    excess_area,
    pooled_mse,
    random_line,
)

FRAMES = [random_buffers(seed, hits=share) for seed, share in enumerate((0.02, 0.1, 0.5))]


def composed_errors(name: str, budget: float) -> list[np.ndarray]:
    """Squared errors of the active pixels of each frame's composed picture."""
    found = []
    for buffers in FRAMES:
        order = refinement_order(buffers, scores_of(buffers)[name])
        picture = refined_picture(buffers, refined_mask(buffers, order, budget))
        found.append((picture.astype(np.float64) - buffers.reference)[buffers.active] ** 2)
    return found


@pytest.mark.parametrize("row, name", list(enumerate(NAMES)))
def test_curves_are_those_of_composed_pictures(row: int, name: str) -> None:
    track = track_of(FRAMES)
    assert len(set(track.active)) == 3, "frames weigh differently"
    pooled = pooled_mse([track])[row]
    for budget in range(101):
        errors = composed_errors(name, budget / 100)
        assert pooled[budget] == pytest.approx(np.concatenate(errors).mean(), rel=1e-12, abs=1e-15)


def test_areas_by_hand() -> None:
    line, best = 0.4 * (1 - BUDGETS), 0.4 * (1 - BUDGETS) ** 2
    assert area(line) == pytest.approx(0.2) and area(best) == pytest.approx(0.4 / 3, rel=1e-3)
    np.testing.assert_allclose(random_line(best), line, rtol=1e-15)
    curves = np.stack([best, line, (best + line) / 2, 2 * line - best])
    np.testing.assert_allclose(excess_area(curves, best), [0, 1, 0.5, 2], atol=1e-12)
    np.testing.assert_allclose(area(curves), ((curves[:, :-1] + curves[:, 1:]) / 2).mean(axis=1), rtol=1e-12)
    assert np.isnan(excess_area(np.zeros((2, 101)), np.zeros(101))).all()
    assert np.isnan(excess_area(line, line)), "equal errors everywhere leave nothing to gain"


def test_crossing_by_hand() -> None:
    others = np.stack([1 - BUDGETS, 0.9 * (1 - BUDGETS)])
    assert crossing(0.5 * (1 - BUDGETS), others) == 0.0
    mine = np.where(BUDGETS >= 0.13, 0.8, 0.95) * (1 - BUDGETS)
    assert crossing(mine, others) == 0.13
    touched = mine.copy()
    touched[40] = others[1, 40]
    assert crossing(touched, others) == 0.41, "equal is not below"
    assert np.isinf(crossing(others[1], others)) and np.isinf(crossing(others[0], others))
    ended = np.where(BUDGETS >= 0.7, 0.0, mine)
    assert crossing(ended, np.where(BUDGETS >= 0.7, 0.0, others)) == 0.13, "both without error from 70 % on"
    assert np.isinf(crossing(np.zeros(101), np.zeros((1, 101))))
    both = crossing(np.stack([mine, touched]), np.stack([others, others]))
    np.testing.assert_array_equal(both, [0.13, 0.41])
