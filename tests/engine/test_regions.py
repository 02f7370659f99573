# SPDX-License-Identifier: GPL-3.0-or-later
"""Regions hold nearly what free tiles would, stay within the budget, do not overlap, and never lose by more budget."""

import numpy as np
import pytest

from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.patchnet_addon.sampling.rectangles import best_rectangle
from patchnet.patchnet_addon.sampling.regions import Region, choose_regions, region_mask
from patchnet.tests.references.small import best_rectangle_reference

HEIGHT, WIDTH = 90, 130  # no multiples of the tile
BUDGETS = (0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.8, 0.95, 1.0)


def hot_spots(seed: int) -> np.ndarray:
    """(HEIGHT, WIDTH) a dozen bright ellipses over weak noise."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    values = 0.02 * rng.random((HEIGHT, WIDTH))
    for _ in range(12):
        across, along = (
            (x - rng.uniform(0, WIDTH)) / rng.uniform(2, 12),
            (y - rng.uniform(0, HEIGHT)) / rng.uniform(2, 20),
        )
        values += np.exp(-(across**2) - along**2)
    return values


def held(priority: np.ndarray, regions: list[Region]) -> float:
    return float(priority[region_mask(regions, *priority.shape)].sum())


@pytest.mark.parametrize("seed", range(20))
def test_best_rectangle_is_the_best_of_all(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape = rng.integers(1, 7, 2)
    values, taken = rng.normal(-0.2, 1.0, shape), rng.random(shape) < 0.2
    value, box = best_rectangle(values, taken)
    expected, _ = best_rectangle_reference(values, taken)
    assert value == pytest.approx(expected)
    if box is None:
        assert taken.all()
    else:
        place = np.s_[box[0] : box[1], box[2] : box[3]]
        assert values[place].sum() == pytest.approx(value) and not taken[place].any()


@pytest.mark.parametrize("seed", range(3))
def test_regions_stay_within_the_budget_and_do_not_overlap(seed: int) -> None:
    priority = hot_spots(seed)
    for budget in BUDGETS:
        regions = choose_regions(priority, budget, tile=8, most=5)
        counts = np.zeros(priority.shape, int)
        for region in regions:
            assert min(region.left, region.bottom) >= 0 and min(region.width, region.height) > 0
            counts[region.slices] += 1
        assert sum(region.pixels for region in regions) == counts.sum(), "within the picture"
        assert counts.max(initial=0) <= 1 and len(regions) <= 5
        assert budget - 0.08 <= counts.mean() <= budget, "most of the budget is spent, never more"


@pytest.mark.parametrize("seed", range(2))
def test_more_budget_never_holds_less(seed: int) -> None:
    priority = hot_spots(seed)
    values = [held(priority, choose_regions(priority, budget, tile=8, most=5)) for budget in np.linspace(0, 1, 21)]
    assert (np.diff(values) >= -1e-9 * priority.sum()).all()
    assert values[0] == 0.0 and values[-1] == pytest.approx(priority.sum())


@pytest.mark.parametrize("seed", range(3))
def test_regions_beat_chance_and_nearly_reach_free_tiles(seed: int) -> None:
    priority, budget, tile = hot_spots(seed), 0.2, 8
    found = held(priority, choose_regions(priority, budget, tile=tile, most=8))
    rng = np.random.default_rng(seed)
    scattered = rng.permutation(priority.ravel())[: round(budget * priority.size)].sum()
    sides = [np.arange(0, size, tile) for size in priority.shape]
    tiles = np.sort(np.add.reduceat(np.add.reduceat(priority, sides[0], axis=0), sides[1], axis=1).ravel())[::-1]
    free = tiles[: round(budget * len(tiles))].sum()
    assert found > 2.0 * scattered
    assert found > 0.85 * free


def test_the_densest_region_is_rendered_first() -> None:
    priority = np.zeros((64, 64))
    priority[:16, :16], priority[48:, 48:] = 1.0, 3.0
    first, second = choose_regions(priority, 0.2)
    assert (first.left, first.bottom) == (48, 48) and (second.left, second.bottom) == (0, 0)


def test_neighbours_share_a_call_where_calls_cost_more_than_the_ground_between() -> None:
    priority = np.zeros((16, 80))
    priority[:, :16] = priority[:, 32:48] = 1.0
    assert [region.width for region in choose_regions(priority, 0.9, overhead_px=100.0)] == [16, 16]
    assert [region.width for region in choose_regions(priority, 0.9, overhead_px=300.0)] == [48]
    assert [region.width for region in choose_regions(priority, 0.9, most=1)] == [48]


def test_edges_of_budget_and_priority() -> None:
    priority = hot_spots(1)
    assert choose_regions(priority, 0.0) == []
    assert choose_regions(np.zeros((20, 30)), 0.5) == []
    assert choose_regions(np.full((20, 30), np.nan), 0.5) == []
    assert choose_regions(-priority, 0.5) == []
    assert region_mask(choose_regions(priority, 1.0), HEIGHT, WIDTH).all()
    (one,) = choose_regions(np.ones((3, 5)), 1.0)
    assert one == Region(0, 0, 5, 3)
    assert choose_regions(np.ones((3, 5)), 0.9) == [], "a tile is the least that can be bought"


@pytest.mark.parametrize("max_px", [1, 20, 65, 1000])
def test_split_parts_are_the_region(max_px: int) -> None:
    whole = Region(3, 5, 20, 11)
    rest: Region | None = whole
    counts = np.zeros((30, 30), int)
    while rest is not None:
        part, rest = rest.split(max_px)
        assert part.pixels <= max(max_px, whole.width)
        counts[part.slices] += 1
    np.testing.assert_array_equal(counts, region_mask([whole], 30, 30))


@pytest.mark.parametrize("wrong", [{"budget": -0.1}, {"budget": 1.1}, {"tile": 0}, {"most": 0}, {"overhead_px": -1.0}])
def test_settings_outside_their_range_are_refused(wrong: dict) -> None:
    with pytest.raises(SettingError):
        choose_regions(np.ones((8, 8)), **{"budget": 0.5, **wrong})


def test_wanted_pixels_come_first_and_priority_gets_the_rest() -> None:
    """Small spots far from each other, which neither overhead nor a rectangle around them all may keep out."""
    priority = np.zeros((64, 96))
    priority[40:60, 40:60] = 1.0
    wanted = np.zeros(priority.shape, bool)
    for row, column in ((3, 5), (30, 90), (60, 2)):
        wanted[row : row + 3, column : column + 3] = True
    regions = choose_regions(priority, 0.15, tile=4, overhead_px=500.0, wanted=wanted)
    mask = region_mask(regions, *priority.shape)
    assert mask[wanted].all() and mask[40:60, 40:60].sum() > 100
    assert mask.sum() == sum(region.pixels for region in regions) <= 0.15 * priority.size
    few = choose_regions(priority, 0.15, tile=4, most=2, wanted=wanted)
    assert len(few) == 2 and region_mask(few, *priority.shape)[wanted].sum() >= 18
    none = choose_regions(priority, 0.2, tile=4, wanted=np.zeros_like(wanted))
    assert none == choose_regions(priority, 0.2, tile=4)
