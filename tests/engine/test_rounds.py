# SPDX-License-Identifier: GPL-3.0-or-later
"""Rounds of a bake: their numbers of paths, who gets more, and the noise of a picture."""

from dataclasses import dataclass

import numpy as np
import pytest

from patchnet.patchnet_addon.light.light_cells import LightCells
from patchnet.patchnet_addon.light.rounds import (
    FIRST_SAMPLES,
    MORE,
    Round,
    first_round,
    next_round,
    picture_noise,
    usual_noise,
)


@dataclass
class Row:
    """A light cell."""

    noise: float = 0.1
    radiance: float = 1.0
    pixels: float = 1.0


def cells_of(rows: list[Row]) -> LightCells:
    noise, radiance, pixels = (
        np.array([getattr(row, name) for row in rows], np.float32) for name in ("noise", "radiance", "pixels")
    )
    none = np.zeros(len(rows), np.uint64)
    return LightCells(none, none, radiance[:, None], noise, radiance, pixels)


def schedule(max_samples: int) -> list[Round]:
    cells = cells_of([Row(noise=9.0)] * 2)
    rounds: list[Round] = []
    now: Round | None = first_round(2, max_samples)
    while now is not None:
        rounds.append(now)
        assert len(rounds) < 20
        now = next_round(now, cells, 0.01, max_samples)
    return rounds


@pytest.mark.parametrize("max_samples", [2, 3, 4, 5, 15, 16, 17, 64, 100, 1024, 65536])
def test_each_round_brings_four_times_the_paths_up_to_the_most(max_samples: int) -> None:
    rounds = schedule(max_samples)
    totals = np.cumsum([one.samples for one in rounds])
    even = max_samples // 2 * 2  # both texels of a surfel have as many
    wanted = [min(FIRST_SAMPLES * MORE**number, even) for number in range(len(rounds))]
    assert totals.tolist() == wanted and totals[-1] == even
    assert [one.number for one in rounds] == list(range(len(rounds))) and all(one.samples > 0 for one in rounds)
    assert all(one.surfels.tolist() == [0, 1] for one in rounds)


def test_only_surfels_of_noisy_cells_go_on() -> None:
    """Of those of the last round, which the fourth was not in; the row after the surfels is a mean."""
    rows = [
        Row(noise=0.2),
        Row(noise=0.3),
        Row(noise=0.001),
        Row(noise=0.2),
        Row(noise=9.0, pixels=0.0),
        Row(noise=9.0),
    ]
    cells = cells_of(rows)
    before = Round(2, np.array([0, 1, 2, 4]), 48)
    after = next_round(before, cells, 0.05, 1000)
    assert after is not None and (after.number, after.surfels.tolist(), after.samples) == (3, [0, 1], 256 - 64)
    only = next_round(before, cells, 0.25, 100)
    assert only is not None and (only.surfels.tolist(), only.samples) == ([1], 100 - 64)
    assert next_round(before, cells, 0.5, 1000) is None


def test_without_any_light_there_is_one_round() -> None:
    assert next_round(first_round(0, 64), cells_of([]), 0.05, 64) is None
    assert next_round(first_round(2, 64), cells_of([Row(0.0, 0.0)] * 2), 0.05, 64) is None


def test_where_no_camera_looks_there_is_one_round() -> None:
    assert next_round(first_round(2, 64), cells_of([Row(noise=9.0, pixels=0.0)] * 2), 0.05, 64) is None


def test_noise_of_a_picture() -> None:
    """Standard deviation over the root of what a white radiance of 1 exposes; dark cells count as nearly black."""
    rows = [Row(), Row(radiance=0.25), Row(radiance=0.0), Row(pixels=0.25), Row(pixels=9.0), Row(pixels=0.0)]
    expected = [0.1, 0.2, 10.0, 0.05, 0.1, 0.0]
    np.testing.assert_allclose(picture_noise(cells_of(rows)), expected, rtol=1e-5)
    for factor in (1e-6, 7.0, 1e6):
        scaled = [Row(factor * row.noise, factor * row.radiance, row.pixels) for row in rows]
        np.testing.assert_allclose(picture_noise(cells_of(scaled)), expected, rtol=1e-5, err_msg="another exposure")
    assert not picture_noise(cells_of([Row(pixels=0.0)])).any()


def test_white_is_a_quantile_of_what_cameras_see() -> None:
    """Two of a thousand cells are far brighter, and many that no camera sees: they do not darken the picture."""
    rows = [Row()] * 998 + [Row(radiance=1e4)] * 2 + [Row(radiance=1e9, pixels=0.0)] * 50
    np.testing.assert_allclose(picture_noise(cells_of(rows))[:998], 0.1, rtol=1e-5)


@pytest.mark.parametrize("light", [1e-3, 1.0, 1e9])
def test_a_picture_that_is_black_but_for_a_lamp(light: float) -> None:
    rows = [Row(0.0, 0.0)] * 999 + [Row(0.1 * light, light)]
    noise = picture_noise(cells_of(rows))
    np.testing.assert_allclose(noise, [0.0] * 999 + [0.1], rtol=1e-5)


def test_usual_noise_is_that_of_nine_of_ten_pixels() -> None:
    """Cells in any order; one that no camera sees does not count."""
    rows = [
        Row(0.4, pixels=6.0),
        Row(9.0, pixels=0.0),
        Row(0.1, pixels=85.0),
        Row(0.3, pixels=6.0),
        Row(0.8, pixels=3.0),
    ]
    assert usual_noise(cells_of(rows)) == pytest.approx(0.3, rel=1e-5)
    rows[2].pixels = 70.0
    assert usual_noise(cells_of(rows)) == pytest.approx(0.4, rel=1e-5)
    assert usual_noise(cells_of([Row(pixels=0.0)])) == usual_noise(cells_of([])) == 0.0
