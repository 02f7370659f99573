# SPDX-License-Identifier: GPL-3.0-or-later
"""Super-sampled pictures of an octree over black (methods 7.5), (H * W,) with row 0 at the bottom."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..cells.scales import LUMINANCE_SCALE
from ..directional.node_kernels import color_along, luminance_of_sides, row_of
from ..directional.node_light import NO_HIGHLIGHTS, HdrHighlights, NodeLight
from ..octree.octree import Nodes, Octree
from ..octree.pieces import NONE, Pieces
from ..runtime.bounds import DEFAULT_LOOKAHEAD, RAYS
from ..runtime.kernels import device, kernel
from ..runtime.progress import Progress, Steps
from ..runtime.threads import run_parts
from ..runtime.vectors import LANES, lowest_one
from ..surface.chroma_kernels import decode_color
from .camera import Camera, CameraUnit, camera_in_unit_cube
from .chosen import Chosen, aim_pixels, corner_of
from .hits import Hits
from .piece_light import see_piece
from .pixel_filter import PixelFilter, Splat, box_splat, grid_places, splat_of
from .pixel_means import PixelMeans
from .render import finer_than_pixel
from .tile import (
    COARSE,
    DIRECTION,
    LENGTH,
    PACKETS,
    PIECE,
    PIXEL,
    SAMPLE,
    SPEED,
    START,
    TILE,
    WANTED,
    Search,
    make_levels,
    make_tile,
    node_seen,
    ray_of,
)
from .tile_walk import trace_tile

MAX_SIDE = int(RAYS.high)  # per pixel side
_NO_STARTS = np.empty(0)
_NO_CHROMA = np.empty((0, 2), np.uint8)
LUMINANCE, COLOR, COVERAGE, MEANS = 0, 1, 4, 5  # columns of means: red, green and blue from COLOR on; their number
_ROWS_PER_STEP = 8
_BEYOND = 1e-9  # a hole, in the octree's cube


class _Seen(NamedTuple):
    """Light that a ray sees; luminance is negative in a hole of a piece, colours lack it where there is no chroma."""

    luminance: np.float32
    red: float
    green: float
    blue: float


class _Light(NamedTuple):
    """Light of nodes: luminance with sides, chroma (empty for gray), and light above white; pieces with their exposure.

    clamps: whether light above white is cut off. footprint: of textures, over that of stops.
    """

    nodes: NodeLight
    chroma: np.ndarray
    above_white: HdrHighlights
    pieces: Pieces
    exposure: float
    clamps: bool
    footprint: float


def supersample(
    octree: Octree, camera: Camera, side: int = MAX_SIDE, *, finer: float | None = None
) -> Steps[PixelMeans]:
    """All pixels, by side x side rays each at regular sub-pixel centres (methods 7.5), without light above white.

    Each ray has the footprint pixel / side, i.e. up to log2(side) levels deeper; with `finer`, pixel / finer. Colours
    are gray without colour. Raises SettingError for sample counts outside 1 to 32.
    """
    parts = []
    for row in range(0, camera.height_px, _ROWS_PER_STEP):
        last = min(row + _ROWS_PER_STEP, camera.height_px)
        pixels = np.arange(row * camera.width_px, last * camera.width_px)
        parts.append(_mean_of_rays(octree, True, camera, pixels, side, finer))  # errors use clamped luminance
        yield Progress(last, camera.height_px, f"Sampling {side}x{side}")
    return PixelMeans(*(np.concatenate(means) for means in zip(*parts, strict=True)))


def supersample_pixels(
    octree: Octree, camera: Camera, pixels: np.ndarray, side: int = MAX_SIDE, *, finer: float | None = None
) -> PixelMeans:
    """Pixels (N,) of `camera`, by their indices row * width + column, as in `supersample`.

    Colours include light above white.
    """
    return _mean_of_rays(octree, False, camera, np.asarray(pixels, np.int64), side, finer)


def behind_patches(octree: Octree, camera: Camera, hits: Hits, *, lookahead: int = DEFAULT_LOOKAHEAD) -> PixelMeans:
    """What rays of pixels meet behind the patches of their hits (methods 3.12); nothing where they miss.

    The footprint is the pixel over `finer_than_pixel`. In an octree with pieces the rays end on the surface.
    """
    means = PixelMeans(*(np.zeros((camera.pixel_count, *shape), np.float32) for shape in ((), (3,), ())))
    hit = np.flatnonzero(hits.hit)
    finer = finer_than_pixel(lookahead)
    found = _mean_of_rays(octree, True, camera, hit, 1, finer, hits.patch_end[hit])
    for all_of, some in zip(means, found, strict=True):
        all_of[hit] = some
    return means


class SpreadPixels(NamedTuple):
    """What rays of N pixels give to the K pixels around each, in rows, the lowest first, itself among them.

    given: (N, K, 4) float32, colours and coverage; a pixel's filtered value is the sum of what it is given. luminance:
    (N,) float32, plain means, as of `supersample_pixels`.
    """

    given: np.ndarray
    luminance: np.ndarray


def spread_pixels(
    octree: Octree,
    camera: Camera,
    pixels: np.ndarray,
    places: np.ndarray,
    pixel_filter: PixelFilter,
    *,
    finer: float | None = None,
) -> SpreadPixels:
    """Pixels (N,) by rays at places (side^2, 2) through a pixel filter, others as in `supersample_pixels`.

    places: `grid_places` or `rook_places`.
    """
    side, splat = math.isqrt(len(places)), splat_of(pixel_filter, places)
    means = _spread(octree, False, camera, np.asarray(pixels, np.int64), side, splat, finer)
    return SpreadPixels(means[:, :-1, COLOR:], means[:, -1, LUMINANCE].copy())


def _mean_of_rays(
    octree: Octree,
    clamps: bool,
    camera: Camera,
    pixels: np.ndarray,
    side: int,
    finer: float | None,
    lengths: np.ndarray = _NO_STARTS,
) -> PixelMeans:
    means = _spread(octree, clamps, camera, pixels, side, box_splat(grid_places(side)), finer, lengths)[:, 0]
    return PixelMeans(*(means[:, part].copy() for part in (LUMINANCE, slice(COLOR, COVERAGE), COVERAGE)))


def _spread(
    octree: Octree,
    clamps: bool,
    camera: Camera,
    pixels: np.ndarray,
    side: int,
    splat: Splat,
    finer: float | None,
    lengths: np.ndarray = _NO_STARTS,
) -> np.ndarray:
    """Means (N, K, MEANS) float32 over side x side rays of each pixel (N,) int64, for each of K rows of a splat.

    clamps: whether light above white is cut off; else it is added to red, green and blue only. Without chroma, these
    are the luminance. lengths: (N,) float64 where a pixel's only ray begins, in the octree's cube; none: where the
    camera sees.
    """
    RAYS.check(side)
    unit = camera_in_unit_cube(camera, octree.grid).finer(side if finer is None else finer)
    chroma, pieces = _NO_CHROMA if octree.chroma is None else octree.chroma, octree.pieces or NONE
    above_white = NO_HIGHLIGHTS if clamps else octree.hdr_highlights
    footprint = 1.0 if finer is None else finer / side
    light = _Light(octree.light, chroma, above_white, pieces, octree.exposure, clamps, footprint)
    chosen = Chosen.by_blocks(pixels, unit.width_px, side, splat.places)
    search = Search(unit.side_at_0, unit.side_per_z, 1.0, COARSE)
    means = np.empty((len(pixels), len(splat.total), MEANS), np.float32)
    starts = lengths[chosen.places] if len(lengths) else lengths
    given = chosen, splat, starts
    run_parts(_means_of_blocks, len(chosen.starts) - 1, octree.exact_nodes, light, unit, search, given, means)
    return means


@kernel
def _means_of_blocks(
    first: int, last: int, nodes: Nodes, light: _Light, camera: CameraUnit, search: Search,
    given: tuple[Chosen, Splat, np.ndarray], means: np.ndarray,
) -> None:  # fmt: skip
    """Write the means of pixels: a block in one tile, or a pixel in several tiles.

    given: `Chosen`, `Splat`, and lengths where rays begin, or none.
    """
    (pixels, places, starts, side, _), splat, lengths = given
    scratch = make_tile(), make_levels(), np.empty((TILE * TILE, len(splat.total), MEANS))
    for block in range(first, last):
        begin = lengths[starts[block] : starts[block + 1]] if len(lengths) else lengths
        here = pixels[starts[block] : starts[block + 1]]
        _sum_rays(nodes, light, camera, search, (here, side, begin, splat), scratch)
        for index in range(starts[block], starts[block + 1]):
            top, left = corner_of(camera, pixels[index], side)
            for around in range(len(splat.total)):
                sums = scratch[2][top * TILE + left, around]
                _write_means(sums, len(light.chroma) > 0, splat.total[around], means[places[index], around])


@device
def _sum_rays(nodes, light, camera, search, given, scratch):
    """Trace the rays of a block's pixels, and sum up their hits for the pixels around each. given: of the block."""
    pixels, side, lengths, splat = given
    tile, levels, sums = scratch
    sums[:] = 0.0
    for first_j in range(0, side, TILE):
        for first_i in range(0, side, TILE):
            aim_pixels(camera, tile, pixels, (first_j, first_i), side, splat.places)
            for index in range(len(lengths)):
                top, left = corner_of(camera, pixels[index], side)
                ray = ray_of(top, left)
                tile.numbers[START, ray] = max(tile.numbers[START, ray], lengths[index])
            while True:  # again for rays that pass a hole of a triangle
                trace_tile(nodes, search, tile, levels)
                some = np.int64(0)
                for packet in range(PACKETS):
                    left, passed = tile.lanes[WANTED, packet], np.int64(0)
                    while left != 0:
                        lane = lowest_one(left)
                        left &= left - 1
                        ray = packet * LANES + lane
                        node = node_seen(camera, tile, COARSE, ray)
                        if node < 0:
                            continue
                        seen = _look(light, search, tile, ray, node)
                        if seen.luminance < 0.0:
                            tile.numbers[START, ray] = tile.numbers[LENGTH, ray] + _BEYOND
                            passed |= np.int64(1) << lane
                            continue
                        sample, own = np.int64(tile.numbers[SAMPLE, ray]), sums[np.int64(tile.numbers[PIXEL, ray])]
                        for around in range(len(own)):
                            _add(seen, splat.weights[around, sample], own[around])
                    tile.lanes[WANTED, packet] = passed
                    some |= passed
                if some == 0:
                    break


@device
def _look(light, search, tile, ray, node):
    """Light that a ray sees."""
    if tile.numbers[PIECE, ray] < 0.0:
        return _seen(tile, ray, node, light)
    pixel = search.at_0 + search.per_z * tile.numbers[LENGTH, ray] * tile.numbers[SPEED, ray]
    luminance, red, green, blue = see_piece(light.pieces, tile, ray, light.footprint * pixel)
    if luminance < 0.0:
        return _Seen(np.float32(luminance), red, green, blue)
    return _exposed(light, luminance, red, green, blue)


@device
def _exposed(light, luminance, red, green, blue):
    """Exposed light of linear light."""
    luminance *= light.exposure
    clamped = min(luminance, 1.0)
    if len(light.chroma) == 0:
        above = 0.0 if light.clamps else luminance - clamped
        return _Seen(np.float32(clamped * LUMINANCE_SCALE), above, above, above)
    scale = light.exposure * (clamped / luminance if light.clamps and luminance > 1.0 else 1.0)
    return _Seen(np.float32(clamped * LUMINANCE_SCALE), scale * red, scale * green, scale * blue)


@device
def _seen(tile, ray, node, light):
    """Light of a voxel that a ray hits."""
    nodes, chroma, above = light.nodes, light.chroma, light.above_white
    numbers = tile.numbers
    x, y, z = numbers[DIRECTION, ray], numbers[DIRECTION + 1, ray], numbers[DIRECTION + 2, ray]
    row = row_of(nodes.sides, node)
    mean = np.float32(nodes.luminance[node])
    luminance = mean if row < 0 else luminance_of_sides(nodes, node, row, x, y, z)
    red = green = blue = 0.0
    if len(chroma):
        own = decode_color(mean / LUMINANCE_SCALE, chroma[node, 0], chroma[node, 1])
        red, green, blue = own if row < 0 else color_along(nodes.sides, row, own, x, y, z)
    bright = row_of(above, node)
    if bright >= 0:
        scale = luminance / max(mean, np.float32(1))  # brightness of the visible side over the mean
        red += scale * above.colors[bright, 0]
        green += scale * above.colors[bright, 1]
        blue += scale * above.colors[bright, 2]
    return _Seen(luminance, red, green, blue)


@device
def _add(seen, weight, sums):
    sums[LUMINANCE] += weight * seen.luminance
    sums[COLOR] += weight * seen.red
    sums[COLOR + 1] += weight * seen.green
    sums[COLOR + 2] += weight * seen.blue
    sums[COVERAGE] += weight


@device
def _write_means(sums, colored, total, means):
    """Write the means (MEANS,) of weighted sums."""
    seen = sums[LUMINANCE] / LUMINANCE_SCALE
    means[LUMINANCE] = seen / total
    for channel in range(COLOR, COVERAGE):
        means[channel] = (sums[channel] + (0.0 if colored else seen)) / total
    means[COVERAGE] = sums[COVERAGE] / total
