# SPDX-License-Identifier: GPL-3.0-or-later
"""Opacity integrated over the outline of a fragment (methods 7.2a); functions for kernels.

The outline is the triangle clipped to its cell again, in texture space. There it is clipped to a raster: texels of the
mip level at which it covers up to `MAX_SQUARES`, or parts of the finest texels if it is small.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..cells.morton_kernels import cell_coordinate
from ..runtime.kernels import device
from .polygon import U, V, X, Y, Z, load_triangle, moments, polygon_bounds, split_x, split_y, split_z
from .texels import bilinear, cut, mip_level, on_texture, opacity_range, wrapped
from .textures import CUT_SAMPLES, MIRROR, REPEAT

MAX_SQUARES = 64  # of a fragment's bounding box
# Squares along a finest texel: where a threshold cuts, fragments far smaller than a texel show its contour.
CUT_PARTS = 32
SOFT_PARTS = 8
SMALL = 0.25  # of a finest texel: bilinear values hardly bend over it
_EVEN = 1e-6
# Polygons by their first row. A triangle cut by six planes has at most 9 vertices, a square of the raster 4 more.
_TRIANGLE, _BELOW, _ABOVE, _PIECE, _REST, _SLAB, _FREE, _SQUARE = (24 * place for place in range(8))
ROWS = 8 * 24


class Raster(NamedTuple):
    """Raster on a texture: `parts` along a finest texel, 0 for whole texels; `columns` * `lines` squares in all."""

    parts: int
    columns: int
    lines: int


class Squares(NamedTuple):
    """Squares of a raster that an outline reaches."""

    x_first: int
    x_last: int
    y_first: int
    y_last: int


@device
def _piece_in_cell(rows, key):
    """Cut the triangle at row 0 by its cell; returns the piece's first row and number of vertices."""
    piece = _TRIANGLE
    count = 3
    for axis in range(3):
        cell = float(cell_coordinate(key, axis))
        low, high = polygon_bounds(rows, piece, count, axis)
        for side in range(2):
            if not (low < cell if side == 0 else high > cell + 1.0):
                continue
            # The half that stays lands in _PIECE or _REST, whichever the polygon is not in.
            kept = _REST if piece == _PIECE else _PIECE
            below = _BELOW if side == 0 else kept
            above = kept if side == 0 else _ABOVE
            if axis == X:
                n_below, n_above = split_x(rows, piece, count, cell + side, below, above)
            elif axis == Y:
                n_below, n_above = split_y(rows, piece, count, cell + side, below, above)
            else:
                n_below, n_above = split_z(rows, piece, count, cell + side, below, above)
            piece = kept
            count = n_above if side == 0 else n_below
            if count < 3:
                return piece, 0
    return piece, count


@device
def piece_on_texture(rows, corners_voxel, key, triangle, uvs, m):
    """Outline of a fragment on the texture, at _PIECE, columns U and V; returns its number of vertices, 0 for none."""
    load_triangle(corners_voxel, triangle, rows)
    piece, count = _piece_in_cell(rows, key)
    for i in range(count):
        s = rows[piece + i, U]
        t = rows[piece + i, V]
        a = uvs[0, 0] + s * (uvs[1, 0] - uvs[0, 0]) + t * (uvs[2, 0] - uvs[0, 0])
        b = uvs[0, 1] + s * (uvs[1, 1] - uvs[0, 1]) + t * (uvs[2, 1] - uvs[0, 1])
        rows[_PIECE + i, U], rows[_PIECE + i, V] = on_texture(m, a, b)
    return count


@device
def _span(low, high, size, margin, wrap):
    """First and last square that [low, high] (in squares) overlaps.

    Beyond a border that does not repeat, a single square stands for all.
    """
    first = math.floor(low)
    last = math.floor(high)
    if wrap in (REPEAT, MIRROR):
        return first, last
    return min(max(first, -margin), size + margin - 1), min(max(last, -margin), size + margin - 1)


@device
def _scale(rows, count, columns, lines):
    """Write the outline in units of squares, counter-clockwise, to columns Y and Z, and U and V.

    Those of U and V are never set onto a line, so that areas add up.
    """
    turn = 0.0
    for i in range(count):
        j = (i + 1) % count
        a = _PIECE + i
        b = _PIECE + j
        turn += (rows[a, U] - rows[_PIECE, U]) * (rows[b, V] - rows[_PIECE, V])
        turn -= (rows[b, U] - rows[_PIECE, U]) * (rows[a, V] - rows[_PIECE, V])
    for i in range(count):
        source = _PIECE + (i if turn >= 0.0 else count - 1 - i)
        x = rows[source, U] * columns
        y = rows[source, V] * lines
        rows[_REST + i, Y], rows[_REST + i, Z] = x, y
        rows[_REST + i, U], rows[_REST + i, V] = x, y


@device
def _square(texels, level, raster, x, y, threshold):
    """Opacity * luminance, and opacity, of one square of a raster."""
    if raster.parts == 0:
        column = wrapped(x, level.width, level.wrap)
        row = wrapped(y, level.height, level.wrap)
        if column < 0 or row < 0:
            return 0.0, 0.0
        texel = level.offset + row * level.width + column
        return float(texels[texel, 0]), float(texels[texel, 1])
    # Where the threshold cuts, the samples of `cut_coverage`, so that all levels say the same of an area. Without it
    # the centre is the mean, as no part crosses a line between the centres of texels.
    side = 1 if math.isnan(threshold) else max(CUT_SAMPLES // raster.parts, 2)
    premultiplied = 0.0
    opacity = 0.0
    for j in range(side):
        v = (y + (j + 0.5) / side) / raster.lines
        for i in range(side):
            u = (x + (i + 0.5) / side) / raster.columns
            sample, sample_opacity = bilinear(texels, level, u, v)
            sample, sample_opacity = cut(sample, sample_opacity, threshold)
            premultiplied += sample
            opacity += sample_opacity
    return premultiplied / (side * side), opacity / (side * side)


@device
def _integrate(rows, count, texels, level, raster, squares, threshold):
    """Cut the outline at _REST into squares of the raster and add them up; returns means over the outline, or -1."""
    area = 0.0
    premultiplied = 0.0
    opacity = 0.0
    rest = _REST
    free = _FREE
    x = squares.x_first
    while x <= squares.x_last and count >= 3:
        if x == squares.x_last:
            slab, n_slab, count = rest, count, 0
        else:
            slab = _SLAB
            n_slab, count = split_y(rows, rest, count, x + 1.0, slab, free)
            rest, free = free, rest
        column, spare = slab, _BELOW
        y = squares.y_first
        if n_slab >= 3:
            low, _ = polygon_bounds(rows, slab, n_slab, Z)
            y = min(max(squares.y_first, math.floor(low)), squares.y_last)
        while y <= squares.y_last and n_slab >= 3:
            if y == squares.y_last:
                piece, n_piece, n_slab = column, n_slab, 0
            else:
                piece = _SQUARE
                n_piece, n_slab = split_z(rows, column, n_slab, y + 1.0, piece, spare)
                column, spare = spare, (_ABOVE if column == slab else column)
            if n_piece >= 3:
                part, _, _ = moments(rows, piece, n_piece)
                if part > 0.0:
                    square, square_opacity = _square(texels, level, raster, x, y, threshold)
                    area += part
                    premultiplied += part * square
                    opacity += part * square_opacity
            y += 1
        x += 1
    if area <= 0.0:
        return -1.0, -1.0
    return premultiplied / area, opacity / area


@device
def footprint_means(rows, count, u, v, texels, levels, chain, threshold):
    """Means of opacity * luminance, and of opacity, over the outline at _PIECE, whose centroid is (u, v).

    Opacity is -1 where the outline has no area on the texture. Luminance times opacity is -1 where opacity is even, so
    that any average of the texture's luminance will do.
    """
    u_low, u_high = polygon_bounds(rows, _PIECE, count, U)
    v_low, v_high = polygon_bounds(rows, _PIECE, count, V)
    step = 0
    level = mip_level(levels, chain, step)
    soft = math.isnan(threshold)
    if soft and max((u_high - u_low) * level.width, (v_high - v_low) * level.height) <= SMALL:
        return bilinear(texels, level, u, v)
    parts = SOFT_PARTS if soft else CUT_PARTS
    while True:
        columns = level.width * max(parts, 1)
        lines = level.height * max(parts, 1)
        margin = max(parts, 1)
        x_first, x_last = _span(u_low * columns, u_high * columns, columns, margin, level.wrap)
        y_first, y_last = _span(v_low * lines, v_high * lines, lines, margin, level.wrap)
        if (x_last - x_first + 1.0) * (y_last - y_first + 1.0) <= MAX_SQUARES:
            break
        parts //= 2
        if parts == 0:
            step += 1
        if step >= chain.level_count:  # many times the whole texture
            texel = level.offset
            premultiplied, opacity = float(texels[texel, 0]), float(texels[texel, 1])
            return cut(premultiplied, opacity, threshold) if step == 1 else (premultiplied, opacity)
        level = mip_level(levels, chain, step)
    if parts > 0:
        left, right = _span(u_low * level.width - 0.5, u_high * level.width - 0.5, level.width, 1, level.wrap)
        low, high = _span(v_low * level.height - 0.5, v_high * level.height - 0.5, level.height, 1, level.wrap)
        least, most = opacity_range(texels, level, left, right + 1, low, high + 1)
        if not soft:
            least = 1.0 if least >= threshold else 0.0
            most = 1.0 if most >= threshold else 0.0
    else:
        least, most = opacity_range(texels, level, x_first, x_last, y_first, y_last)
    if most - least <= _EVEN:
        return -1.0, most
    _scale(rows, count, columns, lines)
    squares = Squares(x_first, x_last, y_first, y_last)
    return _integrate(rows, count, texels, level, Raster(parts, columns, lines), squares, threshold)
