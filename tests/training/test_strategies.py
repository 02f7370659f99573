# SPDX-License-Identifier: GPL-3.0-or-later
"""Strategies of the literature against references written pixel by pixel (methods 3.3 to 3.8)."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from patchnet.patchnet_addon.sampling.pixel_buffers import PixelBuffers
from patchnet.training.strategies.contrasts import tsallis
from patchnet.training.strategies.registry import EVALUATED

SIZES = [(1, 1), (1, 5), (2, 2), (3, 2), (6, 7)]  # windows of 1, 2, 3, 4, 6 and 9 pixels


def shares(values):
    return [value / sum(values) for value in values]


def weighed(contrast):
    """Mean luminance times a contrast of the shares p; 0 for black windows."""
    return lambda values: 0.0 if sum(values) < 1e-6 else sum(values) / len(values) * contrast(shares(values))


def entropy(p):
    return -sum(share * math.log(share) for share in p if share > 0)


def plain_entropy_contrast(p):
    return 1 - entropy(p) / math.log(len(p)) if len(p) > 1 else 0.0


def plain_kl(p):
    return sum(share * math.log(share * len(p)) for share in p if share > 0)


def plain_chi2(p):
    return sum((share - 1 / len(p)) ** 2 * len(p) for share in p)


def plain_hellinger(p):
    return 0.5 * sum((math.sqrt(share) - math.sqrt(1 / len(p))) ** 2 for share in p)


def plain_tsallis(q):
    def contrast(p):
        most = (1 - len(p) ** (1 - q)) / (q - 1)
        return 1 - (1 - sum(share**q for share in p)) / (q - 1) / most if len(p) > 1 else 0.0

    return contrast


def plain_mitchell(values):
    total = max(values) + min(values)
    return 0.0 if total < 1e-6 else (max(values) - min(values)) / total


PLAIN = {
    "mitchell": plain_mitchell,
    "entropy": weighed(plain_entropy_contrast),
    "kl": weighed(plain_kl),
    "chi2": weighed(plain_chi2),
    "chi2-root": weighed(lambda p: math.sqrt(plain_chi2(p))),
    "hellinger": weighed(plain_hellinger),
    "hellinger-root": weighed(lambda p: math.sqrt(plain_hellinger(p))),
    **{f"tsallis-{q:g}": weighed(plain_tsallis(q)) for q in (0.5, 1.5, 2.0, 3.0)},
}


def window(picture, row, column):
    """Values of the 3x3 pixels around that are in the picture, one after the other."""
    height, width = picture.shape
    return [
        float(picture[y, x])
        for y in range(max(row - 1, 0), min(row + 2, height))
        for x in range(max(column - 1, 0), min(column + 2, width))
    ]


def by_pixel(picture, score):
    return np.array([[score(window(picture, y, x)) for x in range(picture.shape[1])] for y in range(picture.shape[0])])


def view(picture, hit=None):
    """A view of a picture (H, W), hit everywhere unless `hit` (H, W) says otherwise."""
    height, width = picture.shape
    hit = np.ones(picture.shape, bool) if hit is None else hit
    luminance = np.asarray(picture, np.float32).ravel()
    return PixelBuffers(SimpleNamespace(height_px=height, width_px=width, hit=hit.ravel(), luminance=luminance))


def noise(seed, size=(6, 7)):
    """Luminances of which a third is black."""
    random = np.random.default_rng(seed)
    return np.where(random.random(size) < 0.33, 0.0, random.random(size)).astype(np.float32)


def geometry_view(seed, size=(6, 7)):
    """Noise with distances, directions and normals, of which some are missing; a third of the pixels is missed."""
    random = np.random.default_rng(seed)
    buffers = view(noise(seed, size), random.random(size) < 0.66)
    hit, pixels = buffers.hit, size[0] * size[1]
    unit = random.normal(size=(2, pixels, 3))
    unit /= np.linalg.norm(unit, axis=2, keepdims=True)
    buffers.hits.direction = unit[0].astype(np.float32)
    buffers.hits.t_world = np.where(hit, random.uniform(0.5, 9.0, pixels), np.inf).astype(np.float32)
    normal = np.where((hit & (random.random(pixels) < 0.9))[:, None], unit[1], 0.0).astype(np.float32)
    return replace(buffers, normal=normal)


@pytest.mark.parametrize("name", PLAIN)
@pytest.mark.parametrize("size", SIZES)
def test_scores_pixel_by_pixel(name, size):
    """To the rounding of float32, and that of a root near 0."""
    for seed in range(5):
        picture = noise(seed, size)
        found = EVALUATED[name].scores(view(picture)).reshape(size)
        np.testing.assert_allclose(found, by_pixel(picture, PLAIN[name]), rtol=1e-6, atol=2e-8)


@pytest.mark.parametrize("size", SIZES)
def test_geometry_pixel_by_pixel(size):
    for seed in range(5):
        buffers = geometry_view(seed, size)
        weight = np.zeros(size)
        for pixel, (row, column) in enumerate(np.ndindex(size)):
            if buffers.hit[pixel]:
                along = sum(
                    float(a) * float(b)
                    for a, b in zip(buffers.normal[pixel], buffers.hits.direction[pixel], strict=True)
                )
                weight[row, column] = abs(along) / float(buffers.hits.t_world[pixel]) ** 2
        geometry = by_pixel(weight, lambda w: plain_entropy_contrast(shares(w)) if sum(w) > 0 else 0.0)
        luminance = by_pixel(buffers.picture(buffers.preview), PLAIN["entropy"])
        found = EVALUATED["entropy-geometry"].scores(buffers).reshape(size)
        np.testing.assert_allclose(found, (luminance + geometry) / 2, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("name", [*PLAIN, "ss-variance-hits"])
@given(level=st.integers(0, 65535), size=st.sampled_from(SIZES))
@settings(max_examples=25, deadline=None)
def test_constant_pictures_score_exactly_0(name, level, size):
    """At the borders too: what is outside of the picture does not count as black."""
    assert not EVALUATED[name].scores(view(np.full(size, level / 65535))).any()


def test_variance_of_hits():
    hit = np.random.default_rng(0).random((9, 8)) < 0.6
    buffers = view(np.where(hit, noise(4, (9, 8)), 0.0), hit)
    found, all_of_them = (EVALUATED[name].scores(buffers) for name in ("ss-variance-hits", "ss-variance"))
    np.testing.assert_array_equal(found, np.where(buffers.hit, all_of_them, 0))
    assert found.any() and all_of_them[~buffers.hit].any()


def test_any_entropic_index_is_a_strategy():
    picture = noise(2)
    found = tsallis(0.8).scores(view(picture)).reshape(picture.shape)
    np.testing.assert_allclose(found, by_pixel(picture, weighed(plain_tsallis(0.8))), rtol=1e-6, atol=2e-8)
