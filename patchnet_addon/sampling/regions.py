# SPDX-License-Identifier: GPL-3.0-or-later
"""Regions for renderers that take only rectangles: few that hold most of a priority map within a budget.

Objective: the greatest sum of priority inside disjoint rectangles of whole tiles, with at most `most` rectangles and at
most `budget` of the picture's pixels. It is solved greedily under a price per pixel, as in Lagrangian relaxation: the
rectangle with the greatest surplus, priority less price x (pixels + overhead), found exactly (`rectangles`), is taken
again and again until none has any. `overhead_px` is what a call of the renderer costs beside its pixels, so two hot
spots become one rectangle where the ground between them costs less than another call. Rectangles then grow by the
strip of tiles with most priority per pixel. Of all prices the one that holds most priority within the budget wins;
neither prices nor the order of growth know the budget, so more budget never holds less.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..runtime.errors import SettingError
from .rectangles import Box, best_rectangle

DEFAULT_TILE, DEFAULT_MOST = 16, 8
_PRICES = 24


@dataclass(frozen=True)
class Region:
    """Rectangle of pixels; row 0 is the bottom."""

    left: int
    bottom: int
    width: int
    height: int

    @property
    def pixels(self) -> int:
        """Area of the rectangle."""
        return self.width * self.height

    @property
    def slices(self) -> tuple[slice, slice]:
        """Rows and columns of a picture (H, W)."""
        return slice(self.bottom, self.bottom + self.height), slice(self.left, self.left + self.width)

    def split(self, max_px: int) -> tuple[Region, Region | None]:
        """Split off the lower rows, at most `max_px` pixels but one row at least, and the rest, if there is one."""
        rows = min(max(1, max_px // self.width), self.height)
        rest = Region(self.left, self.bottom + rows, self.width, self.height - rows) if rows < self.height else None
        return Region(self.left, self.bottom, self.width, rows), rest


@dataclass(frozen=True, eq=False)
class _Tiles:
    """Sums over tiles (R, C) float64: priority and pixels; those at the picture's upper and right edges are smaller."""

    priority: np.ndarray
    pixels: np.ndarray

    def sums(self, box: Box) -> tuple[float, int]:
        """Priority and pixels of rows box[0]:box[1], columns box[2]:box[3]."""
        inside = np.s_[box[0] : box[1], box[2] : box[3]]
        return float(self.priority[inside].sum()), int(self.pixels[inside].sum())


def choose_regions(
    priority: np.ndarray,
    budget: float,
    *,
    tile: int = DEFAULT_TILE,
    most: int = DEFAULT_MOST,
    overhead_px: float = 0.0,
    wanted: np.ndarray | None = None,
) -> list[Region]:
    """Disjoint regions for `priority` (H, W); negative or missing values count as 0; the densest region is first.

    wanted: (H, W) bool, pixels that come before all others, whatever their priority and the overhead.

    budget: share of the picture's pixels, 0 to 1. tile: side of the tiles in pixels. most: regions at most.
    A map without priority has no regions, whatever the budget. Raises SettingError for values outside their range.
    """
    _check(budget, tile, most, overhead_px)
    height, width = priority.shape
    affordable = int(np.floor(budget * height * width + 1e-9))
    boxes: list[Box] = []
    tiles = _tiles(priority, tile)
    taken = np.zeros(tiles.pixels.shape, bool)
    stages = [(tiles, overhead_px)] if wanted is None else [(_tiles(wanted, tile), 0.0), (tiles, overhead_px)]
    for asked, overhead in stages:
        best: list[Box] = []
        for price in _prices(asked):
            bought = _bought(asked, price, most - len(boxes), overhead, taken)
            grown = _grown(asked, bought, affordable, taken)
            best = max(best, grown, key=lambda found: _worth(asked, found, overhead))
        for box in best:
            taken[box[0] : box[1], box[2] : box[3]] = True
            affordable -= tiles.sums(box)[1]
        boxes += best
    boxes.sort(key=lambda box: -np.divide(*tiles.sums(box)))
    return [_region(box, tile, height, width) for box in boxes]


def region_mask(regions: list[Region], height: int, width: int) -> np.ndarray:
    """(H, W) bool: the pixels of all regions."""
    mask = np.zeros((height, width), bool)
    for region in regions:
        mask[region.slices] = True
    return mask


def _worth(tiles: _Tiles, boxes: list[Box], overhead_px: float) -> tuple[float, float]:
    """Priority held, as a share that sums in any order agree on; of equal ones, what costs less is worth more."""
    sums = [tiles.sums(box) for box in boxes]
    share = sum(priority for priority, _ in sums) / max(float(tiles.priority.sum()), 1e-300)
    return round(share, 12), -sum(pixels + overhead_px for _, pixels in sums)


def _check(budget: float, tile: int, most: int, overhead_px: float) -> None:
    if not 0.0 <= budget <= 1.0:
        raise SettingError(f"Budget {budget} is outside 0 to 1: give the share of pixels to render")
    if tile < 1 or most < 1:
        raise SettingError(f"Tiles of {tile} pixels and {most} regions are impossible: choose at least 1 of each")
    if not overhead_px >= 0.0:
        raise SettingError(f"An overhead of {overhead_px} pixels is impossible: give 0 or more")


def _tiles(priority: np.ndarray, tile: int) -> _Tiles:
    clean = np.nan_to_num(np.maximum(priority, 0.0).astype(np.float64), nan=0.0, posinf=0.0)
    rows, columns = (np.arange(0, size, tile) for size in priority.shape)

    def summed(values: np.ndarray) -> np.ndarray:
        return np.add.reduceat(np.add.reduceat(values, rows, axis=0), columns, axis=1)

    return _Tiles(summed(clean), summed(np.ones(priority.shape)))


def _prices(tiles: _Tiles) -> np.ndarray:
    """Prices per pixel to try: quantiles of the tiles' own density, half the least, and none.

    Half the least buys all that has priority, but no ground between; none buys the ground too.
    """
    density = (tiles.priority / tiles.pixels)[tiles.priority > 0]
    if not density.size:
        return np.zeros(0)
    return np.unique([*np.quantile(density, np.linspace(0.0, 1.0, _PRICES)), density.min() / 2.0, 0.0])


def _bought(tiles: _Tiles, price: float, most: int, overhead_px: float, taken: np.ndarray) -> list[Box]:
    """At most `most` disjoint boxes beside those taken, worth more than their price, the greatest surplus first."""
    surplus = tiles.priority - price * tiles.pixels
    taken = taken.copy()
    boxes: list[Box] = []
    while len(boxes) < most:
        value, box = best_rectangle(surplus, taken)
        if box is None or (value <= price * overhead_px and boxes) or tiles.sums(box)[0] <= 0:
            break
        boxes.append(box)
        taken[box[0] : box[1], box[2] : box[3]] = True
    return boxes


def _grown(tiles: _Tiles, bought: list[Box], affordable: int, taken: np.ndarray) -> list[Box]:
    """Boxes that fit into `affordable` pixels: those bought, in their order, then strips of tiles at their sides.

    It ends at the first that does not fit: what is taken for less budget is always a beginning of this.
    """
    taken = taken.copy()
    boxes: list[Box] = []
    left = affordable
    for box in bought:
        pixels = tiles.sums(box)[1]
        if pixels > left:
            return boxes
        boxes.append(box)
        taken[box[0] : box[1], box[2] : box[3]] = True
        left -= pixels
    while strips := [strip for index, box in enumerate(boxes) for strip in _strips(tiles, taken, index, box)]:
        _, pixels, index, box = max(strips)
        if pixels > left:
            break
        boxes[index] = box
        taken[box[0] : box[1], box[2] : box[3]] = True
        left -= pixels
    return boxes


def _strips(tiles: _Tiles, taken: np.ndarray, index: int, box: Box) -> list[tuple[float, int, int, Box]]:
    """Priority per pixel, pixels, `index` and the grown box of each side's strip that is free and holds priority."""
    top, end, left, right = box
    rows, columns = taken.shape
    sides = [
        ((top - 1, top, left, right), (top - 1, end, left, right), top > 0),
        ((end, end + 1, left, right), (top, end + 1, left, right), end < rows),
        ((top, end, left - 1, left), (top, end, left - 1, right), left > 0),
        ((top, end, right, right + 1), (top, end, left, right + 1), right < columns),
    ]
    found = []
    for strip, grown, inside in sides:
        if inside and not taken[strip[0] : strip[1], strip[2] : strip[3]].any():
            priority, pixels = tiles.sums(strip)
            if priority > 0:
                found.append((priority / pixels, pixels, index, grown))
    return found


def _region(box: Box, tile: int, height: int, width: int) -> Region:
    bottom, left = box[0] * tile, box[2] * tile
    return Region(left, bottom, min(box[3] * tile, width) - left, min(box[1] * tile, height) - bottom)
