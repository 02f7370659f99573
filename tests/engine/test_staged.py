# SPDX-License-Identifier: GPL-3.0-or-later
"""Staged ranking: traced and known pixels agree, and the number of pixels that are traced."""

import math

import numpy as np
import pytest

from patchnet.patchnet_addon.codes.encode import encode_octree
from patchnet.patchnet_addon.network.weights import Weights
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.sampling.adaptive import AdaptivePicture, Pace
from patchnet.patchnet_addon.sampling.patchnet_plus import NEEDS
from patchnet.patchnet_addon.sampling.plus.forms import FORMS
from patchnet.patchnet_addon.sampling.ranking import rank
from patchnet.patchnet_addon.sampling.refine import refined_mask, refinement_order
from patchnet.patchnet_addon.sampling.registry import STRATEGIES
from patchnet.patchnet_addon.sampling.staged_strategy import (
    KnownPixels,
    Looks,
    Plan,
    Stage,
    StagedStrategy,
    first_scores,
    staged_scores,
)
from patchnet.patchnet_addon.sampling.strategy import Strategy
from patchnet.patchnet_addon.sampling.trace import trace_view
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.tests.engine.octree_samples import random_octree
from patchnet.tests.references.small import random_estimators
from patchnet.training.strategies.registry import EVALUATED

ALL = Strategy("all", "All", "All that estimators see", NEEDS, lambda buffers: buffers.preview, "luminance", 1.0)
CAMERA = Camera.look_at(np.array([2.1, 1.4, 1.2]), np.full(3, 0.5), size_px=(60, 40))
BUDGETS = [0.0, 0.1, 0.7]
STAGED = sorted(name for name, strategy in EVALUATED.items() if isinstance(strategy, StagedStrategy))


@pytest.fixture(scope="module")
def coded():
    return drain(encode_octree(random_octree(depth=7, count=400), Weights.random(seed=3)))


@pytest.fixture(scope="module")
def buffers(coded):
    return drain(trace_view(coded.octree, CAMERA, [ALL], coded=coded, reference=False))


@pytest.fixture(scope="module")
def estimators():
    return random_estimators(seed=5)


@pytest.fixture(scope="module")
def looks(coded):
    return Looks(coded.octree, CAMERA, coded)


@pytest.fixture(scope="module")
def first(coded):
    """What is traced of the whole picture before the stages."""
    wanted = EVALUATED["patchnet-plus-staged"].first_look()
    return drain(trace_view(coded.octree, CAMERA, [wanted], coded=coded, reference=False))


@pytest.mark.parametrize("name", STAGED)
@pytest.mark.parametrize("budget", BUDGETS)
def test_what_is_traced_is_what_is_known(name, budget, first, looks, buffers):
    strategy = EVALUATED[name]
    assert first.behind is None and first.prediction is None and first.fine_rays is None
    scores = rank(strategy, first, budget, looks).score
    np.testing.assert_array_equal(scores, rank(strategy, buffers, budget).score)
    assert scores.dtype == np.float32


@pytest.mark.parametrize("around", [True, False])
@pytest.mark.parametrize("budget", BUDGETS)
def test_the_last_stage_decides_who_is_refined(budget, around, buffers, estimators):
    """A plain copy of the rule: those that are sure, then the best of those that the last stage has looked at."""
    stages = Stage(FORMS["fine-1"], 0.3, 2.0), Stage(FORMS["plus-4"], 0.6, 1.3)
    scores = staged_scores(buffers, None, Plan(stages, around), budget, estimators)
    active = np.flatnonzero(buffers.active)
    count = round(budget * len(active))
    known = KnownPixels(buffers, None)
    value, pool, sure = first_scores(buffers, around=around), active, []
    for stage in stages:
        falling = pool[np.argsort(-value[pool], kind="stable")]
        low = max(math.floor(stage.sure * count) - len(sure), 0)
        high = max(math.ceil(stage.reached * count) - len(sure), 0)
        sure, pool = [*sure, *falling[:low]], np.sort(falling[low:high])
        if len(pool):
            value[pool] = known.estimate(stage.form, pool, estimators)
    expected = np.zeros(len(scores), bool)
    expected[[*sure, *pool[np.argsort(-value[pool], kind="stable")][: count - len(sure)]]] = True
    refined = refined_mask(buffers, refinement_order(buffers, scores), budget)
    assert refined.sum() == count == expected.sum()
    assert (refined == expected).mean() > 0.995  # but for equal scores


def test_only_some_pixels_are_looked_at_closely(first, looks, monkeypatch):
    counts = {}

    def counted(self, part, hits, pixels):
        counts[part] = counts.get(part, 0) + len(pixels)
        return look(self, part, hits, pixels)

    look = Looks.look
    monkeypatch.setattr(Looks, "look", counted)
    rank(EVALUATED["patchnet-plus-staged"], first, 0.1, looks)
    assert counts.keys() == {"fine_rays"}  # the network takes part near the whole budget alone
    assert 0 < counts.pop("fine_rays") < 1.5 * 0.1 * first.active.sum()
    rank(EVALUATED["patchnet-plus-1-staged"], first, 0.1, looks)
    assert not counts  # the finer ray is of all pixels
    rank(EVALUATED["patchnet-plus-1-staged"], first, 0.3, looks)
    assert counts.keys() == {"normal", "child_mask", "behind", "prediction"}


@pytest.mark.parametrize("with_codes", [False, True])
def test_pictures_with_a_budget_rank_in_stages(with_codes, coded, first, looks):
    """In bands, with the network's prediction of all pixels that a pass shows, or without."""
    strategy = EVALUATED["patchnet-plus-1-staged"]
    picture = AdaptivePicture(coded.octree, CAMERA, strategy, coded if with_codes else None, budget=0.1)
    drain(picture.trace(Pace(band_pixels=200)))
    scores = rank(strategy, first, 0.1, looks).score
    assert (np.abs(picture.ranking.score - scores) > 1e-5).mean() < 0.02  # rays of bands are rounded otherwise
    assert (picture.ranking.buffers.prediction is not None) == with_codes and picture.ranking.buffers.behind is None
    drain(picture.refine(0.1))
    assert (picture.samples > 1).sum() == round(0.1 * picture.ranking.buffers.active.sum())


@pytest.mark.parametrize("settings", [{"budget": None}, {"budget": 0.3, "unrefined": "predicted"}, {"budget": 0.9}])
def test_without_a_budget_and_near_all_pixels_are_looked_at_alike(settings, coded):
    picture = AdaptivePicture(coded.octree, CAMERA, STRATEGIES["patchnet-plus-staged"], coded, **settings)
    drain(picture.trace())
    whole = AdaptivePicture(coded.octree, CAMERA, STRATEGIES["patchnet-plus"], coded, **settings | {"budget": None})
    drain(whole.trace())
    active = picture.ranking.buffers.active
    np.testing.assert_allclose(picture.ranking.score[active], whole.ranking.score[active], rtol=1e-4)
