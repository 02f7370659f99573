# SPDX-License-Identifier: GPL-3.0-or-later
"""Strategies of finer rays against the reference of rays, and their sums with variance."""

from dataclasses import replace

import numpy as np
import pytest

from patchnet.patchnet_addon.codes.encode import encode_octree
from patchnet.patchnet_addon.network.weights import Weights
from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.sampling.trace import trace_view
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.tests.engine.octree_samples import random_octree
from patchnet.tests.references.first_hits import hits_of_pixels, shown_by
from patchnet.training.strategies.registry import EVALUATED

EYE = np.array([2.1, 1.4, 1.2])
CHOSEN = (
    "fusion", "fine-ray", "fine-ray-variance", "fine-rays-4", "fine-rays-4-variance", "patchnet-behind", "ss-variance"
)  # fmt: skip


@pytest.fixture(scope="module")
def octree():
    return random_octree(depth=7, count=400)


@pytest.fixture(scope="module")
def camera():
    return Camera.look_at(EYE, np.full(3, 0.5), size_px=(24, 18))


@pytest.fixture(scope="module")
def buffers(octree, camera):
    coded = drain(encode_octree(octree, Weights.random(seed=3)))
    chosen = [EVALUATED[name] for name in CHOSEN]
    return drain(trace_view(octree, camera, chosen, coded=coded, reference=False))


def seen(octree, camera, finer):
    return shown_by(octree, hits_of_pixels(octree, camera, finer)[0])


def test_the_finer_ray_of_a_pixel(octree, camera, buffers):
    """It goes on from the voxel that the centre ray met, so it is a miss where that met nothing."""
    expected = np.where(buffers.hit, seen(octree, camera, 8.0), np.float32(0))
    np.testing.assert_array_equal(buffers.fine, expected)
    assert (buffers.fine != buffers.preview).any()


def test_four_finer_rays_are_those_of_a_picture_twice_as_large(octree, camera, buffers):
    large = seen(octree, replace(camera, width_px=48, height_px=36), 4.0).reshape(18, 2, 24, 2)
    mean = large.mean(axis=(1, 3)).ravel()
    score = EVALUATED["fine-rays-4"].scores(buffers)
    np.testing.assert_allclose(score, np.abs(buffers.preview - mean), atol=1e-7)


@pytest.mark.parametrize(
    "name, expected",
    [("fusion", "patchnet-behind"), ("fine-ray-variance", "fine-ray"), ("fine-rays-4-variance", "fine-rays-4")],
)
def test_sums_with_variance(buffers, name, expected):
    alone = EVALUATED[expected].scores(buffers).astype(np.float64)
    variance = EVALUATED["ss-variance"].scores(buffers)
    np.testing.assert_allclose(EVALUATED[name].scores(buffers), np.sqrt(alone**2 + variance / 4), rtol=1e-5, atol=1e-7)


def test_what_is_missing_is_named(octree, camera):
    plain = drain(trace_view(octree, camera, [], reference=False))
    with pytest.raises(SettingError, match="'fine-rays-4' needs the view's fine_rays"):
        EVALUATED["fine-rays-4"].scores(plain)
