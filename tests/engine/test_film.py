# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures through pixel filters, against sums over all rays in plain NumPy."""

import numpy as np
import pytest

from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.sampling import film as film_module
from patchnet.patchnet_addon.sampling.adaptive import AdaptivePicture, Pace
from patchnet.patchnet_addon.sampling.film import Film
from patchnet.patchnet_addon.sampling.registry import STRATEGIES
from patchnet.patchnet_addon.sampling.trace import trace_view
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.patchnet_addon.tracing.pixel_filter import (
    BLACKMAN_HARRIS,
    BOX,
    EVEN_FOOTPRINT,
    GAUSSIAN,
    PixelFilter,
    grid_places,
    rook_places,
)
from patchnet.patchnet_addon.tracing.supersample import supersample
from patchnet.tests.engine.octree_samples import random_octree
from patchnet.tests.references.first_hits import first_hits_reference, shown_by

EYE = Camera.look_at(np.array([1.9, -1.1, 1.4]), np.full(3, 0.5), fov=0.8, size_px=(13, 11))
FILTERS = [
    PixelFilter(),
    PixelFilter(BLACKMAN_HARRIS, 1.5),
    PixelFilter(GAUSSIAN, 1.5),
    PixelFilter(BLACKMAN_HARRIS, 4.0),
    PixelFilter(GAUSSIAN, 0.1),
    PixelFilter(BLACKMAN_HARRIS, 0.01),
]


def window(kind: str, width: float, distance: np.ndarray) -> np.ndarray:
    """A filter as Cycles' film tabulates it, at distances from a pixel's centre."""
    if kind == BOX:
        return (np.abs(distance) <= 0.5).astype(float)
    wide = width * (3.0 if kind == GAUSSIAN else 2.0)
    inside = np.abs(distance) <= wide / 2.0
    if kind == GAUSSIAN:
        return inside * np.exp(-2.0 * (6.0 * distance / wide) ** 2)
    v = 2.0 * np.pi * (distance / wide + 0.5)
    return inside * (0.35875 - 0.48829 * np.cos(v) + 0.14128 * np.cos(2 * v) - 0.01168 * np.cos(3 * v))


def plain_picture(
    octree: Octree, eye: Camera, places: np.ndarray, footprints: int, pixel_filter: PixelFilter
) -> np.ndarray:
    """(P, 2): luminance and coverage, weighted over all rays of the picture."""
    row, column = np.divmod(np.arange(eye.pixel_count), eye.width_px)
    x, y = ((along[:, None] + places[:, axis]).ravel() for axis, along in enumerate((column, row)))
    across, up = 2 * x / eye.width_px - 1, 2 * y / eye.height_px - 1
    nodes, _ = first_hits_reference(octree, eye, across, up, 1.0 / footprints)
    seen = np.stack([shown_by(octree, nodes), nodes >= 0], axis=1)
    weights = window(*pixel_filter, (column + 0.5)[:, None] - x) * window(*pixel_filter, (row + 0.5)[:, None] - y)
    return weights @ seen / weights.sum(axis=1)[:, None]


def even_picture(octree: Octree, side: int, pixel_filter: PixelFilter, pace: Pace | None = None) -> AdaptivePicture:
    picture = AdaptivePicture(octree, EYE, None, pixel_filter=pixel_filter)
    drain(picture.trace(pace))
    drain(picture.sample_evenly(side, pace))
    return picture


@pytest.mark.parametrize("pixel_filter", FILTERS[:4], ids=str)
@pytest.mark.parametrize("side", [3, 4, 9])
def test_an_even_picture_weighs_all_rays(pixel_filter: PixelFilter, side: int) -> None:
    """What a pixel gets from each around it is the share of the filter there: few rays depart from it a little."""
    octree = random_octree()
    found, footprints = even_picture(octree, side, pixel_filter), max(side, EVEN_FOOTPRINT)
    expected = plain_picture(octree, EYE, rook_places(side), footprints, pixel_filter)
    np.testing.assert_allclose(found.values[:, 3], expected[:, 1], atol=2e-2 if side < 9 else 2e-3)
    np.testing.assert_allclose(found.values[:, 0], expected[:, 0], atol=2e-2 if side < 9 else 2e-3)
    assert np.abs(found.values[:, 3] - expected[:, 1]).mean() < 2e-3


def test_a_reference_weighs_all_rays() -> None:
    """Its luminance is a plain mean, as without a filter."""
    octree, eye, pixel_filter = random_octree(), EYE.with_size(5, 4), PixelFilter(BLACKMAN_HARRIS, 1.5)
    found = drain(trace_view(octree, eye, [], pixel_filter=pixel_filter))
    expected = plain_picture(octree, eye, grid_places(32), 32, pixel_filter)
    np.testing.assert_allclose(found.reference_alpha, expected[:, 1], atol=1e-4)
    np.testing.assert_array_equal(found.reference, drain(supersample(octree, eye)).luminance)
    assert np.abs(found.reference_alpha - drain(supersample(octree, eye)).coverage).max() > 0.02


@pytest.mark.parametrize("pixel_filter", FILTERS, ids=str)
def test_shares_are_those_of_cycles(pixel_filter: PixelFilter) -> None:
    radius, shares = pixel_filter.radius, pixel_filter.shares()
    steps = (np.arange(100 * (2 * radius + 3)) + 0.5) / 100 - radius - 1.5
    sums = window(*pixel_filter, steps).reshape(-1, 100).sum(axis=1)
    assert sums[0] == sums[-1] == 0.0, "nothing is beyond the radius"
    np.testing.assert_allclose(shares, sums[1:-1] / sums.sum(), atol=2e-3)
    assert radius == 0 or shares[0] > 0.0


@pytest.mark.parametrize("pixel_filter", FILTERS, ids=str)
def test_an_even_light_stays_as_it_is(pixel_filter: PixelFilter) -> None:
    """At the picture's edge too, with one ray and with many, in pixels of different numbers of them."""
    film = Film((13, 11), pixel_filter)
    single = np.tile(np.array([0.25, 0.5, 3000.0, 1.0], np.float32), (13 * 11, 1))
    film.show(0, single[:26]), film.show(26, single[26:])
    np.testing.assert_allclose(film.values, single, rtol=1e-6)
    chosen = np.random.default_rng(0).permutation(13 * 11)[:40]
    given = film.given(chosen)
    film.replace(chosen, given, np.zeros_like(given))
    assert (film.values[chosen, 3] < 1.0).all()
    film.replace(chosen, np.zeros_like(given), given)
    np.testing.assert_allclose(film.values, single, rtol=1e-6)
    assert (film.values[:, 3] == 1.0).all(), "what is covered is covered, to the last bit"
    film.show(0, np.zeros_like(single))
    assert not film.values.any(), "and what is empty empty"


def test_the_order_of_work_does_not_matter() -> None:
    """To the last bit: in bands and batches, or refined by few rays first and by more then."""
    octree, pixel_filter = random_octree(), PixelFilter(BLACKMAN_HARRIS, 1.5)
    at_once = even_picture(octree, 4, pixel_filter)
    in_parts = even_picture(octree, 4, pixel_filter, Pace(band_pixels=30, batch_rays=200))
    np.testing.assert_array_equal(in_parts.values, at_once.values)
    direct, twice = (AdaptivePicture(octree, EYE, STRATEGIES["ss-variance"], pixel_filter=pixel_filter) for _ in "12")
    for picture, sides in ((direct, (32,)), (twice, (4, 32))):
        drain(picture.trace())
        for side in sides:
            drain(picture.refine(0.4, side))
    np.testing.assert_array_equal(twice.samples, direct.samples)
    np.testing.assert_array_equal(twice.values, direct.values)


def test_a_wide_filter_is_spread_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    octree, pixel_filter = random_octree(), PixelFilter(GAUSSIAN, 10.0)
    assert pixel_filter.radius == 15
    whole = even_picture(octree, 2, pixel_filter)
    monkeypatch.setattr(film_module, "_SHARES_AT_ONCE", 5000)
    parts = even_picture(octree, 2, pixel_filter)
    np.testing.assert_array_equal(parts.values, whole.values)


@pytest.mark.parametrize("side", [1, 2, 3, 4, 7, 8, 32])
def test_rooks_share_neither_columns_nor_rows(side: int) -> None:
    places = rook_places(side)
    for axis in range(2):
        np.testing.assert_array_equal(np.sort(places[:, axis]), (np.arange(side**2) + 0.5) / side**2)
    cells = np.floor(places * side).astype(int)
    np.testing.assert_array_equal(cells[:, 1] * side + cells[:, 0], np.arange(side**2))
