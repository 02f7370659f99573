# SPDX-License-Identifier: GPL-3.0-or-later
"""Pixels for an expensive renderer come by priority, after those that nothing else shows."""

from dataclasses import replace

import numpy as np
import pytest

from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.patchnet_addon.sampling.chosen_pixels import chosen_pixels
from patchnet.patchnet_addon.sampling.ranking import rank
from patchnet.patchnet_addon.sampling.registry import strategy

from .test_sampling import random_buffers


def test_the_worst_pixels_of_a_budget_after_those_that_come_first() -> None:
    buffers = random_buffers()
    importance = np.where(np.arange(len(buffers.preview)) % 5 == 0, 0.0, 1.0).astype(np.float32)
    ranking = rank(strategy("ss-variance"), replace(buffers, importance=importance), 0.3)
    nobody, first = np.zeros(len(importance), bool), np.zeros(len(importance), bool)
    active = buffers.active & (importance > 0.0)
    for budget in (0.0, 0.1, 0.37):
        chosen = chosen_pixels(ranking, nobody, budget)
        assert chosen.sum() == int(budget * len(importance)) and (chosen <= active).all()
        assert not chosen.any() or ranking.priority[chosen].min() >= ranking.priority[active & ~chosen].max()
    first[~buffers.active | (importance == 0.0)] = True
    few = chosen_pixels(ranking, first, 0.02)
    assert (few <= first).all() and few.sum() == int(0.02 * len(importance))
    assert chosen_pixels(ranking, first, 1.0).all()
    np.testing.assert_array_equal(chosen_pixels(ranking, nobody, 1.0), importance > 0.0)


def test_a_budget_outside_its_range_is_refused() -> None:
    buffers = random_buffers()
    with pytest.raises(SettingError, match="share of pixels"):
        chosen_pixels(rank(strategy("random"), buffers, 0.3), ~buffers.active, 1.1)
