# SPDX-License-Identifier: GPL-3.0-or-later
"""Pack charts onto pages, without a search.

Two triangles share a rectangle of 2^a x 2^b texels, b <= a. Rectangles of one width, the highest first, are stacked in
squares of 2^a x 2^a, and squares, the largest first, follow a Morton curve: a square's position is the number of texels
before it. A page holds triangles of one number of paths only; its unused halves and quarters are cut off.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..cells.morton import morton_decode_square

FIRST, SECOND, SINGLE = range(3)


def packed(
    sides: np.ndarray, shares: np.ndarray, neighbours: np.ndarray | None, page_side: int
) -> tuple[dict[str, Any], np.ndarray]:
    """Place the charts of T triangles on P pages: page_side, page, x, y, kind and page_size of `Charts`.

    Also the class (P,) int32 of the triangles on each page.
    sides: (T, 2) int8, log2 of rectangles' width and height. shares: (T,) uint8 classes, each with separate pages.
    neighbours: (T,) int32, order of single texels of a class; None for the order of triangles. page_side: a power of
    two; pages are larger if a square needs it, and smaller if all texels fit.
    """
    counts = np.bincount(shares, minlength=1)
    order = np.arange(len(sides)) if neighbours is None else np.argsort(neighbours, kind="stable")
    kinds = (shares.astype(np.uint16) << 8) | _classes(sides)
    order = order[np.argsort(kinds[order], kind="stable")]
    least = max(texel_count(sides[shares == share]) for share in np.flatnonzero(counts)) if len(sides) else 1
    log_side = max(int(sides.max(initial=0)), min(int(np.log2(page_side)), int(np.ceil(np.log2(max(least, 1)) / 2))))
    place = np.empty(len(order), np.int64)  # texels before the triangle's square
    stacked = np.zeros(len(order), np.int32)  # height in its square
    kind = np.full(len(order), SINGLE, np.int8)
    pages: list[int] = []
    used: list[int] = []  # texels of each page
    first = 0
    for share in np.flatnonzero(counts):
        members = order[first : first + counts[share]]
        first += len(members)
        start = len(pages) << (2 * log_side)
        total = _along_curve(members, sides, place, stacked, kind, start)
        number = max(1, -(-total // (1 << (2 * log_side))))
        pages += [share] * number
        used += [1 << (2 * log_side)] * (number - 1) + [total - ((number - 1) << (2 * log_side))]
    page, rest = place >> (2 * log_side), place & ((1 << (2 * log_side)) - 1)
    x, y = morton_decode_square(rest)
    places = {
        "page_side": 1 << log_side,
        "page": page.astype(np.int32),
        "x": x,
        "y": y + stacked,
        "kind": kind,
        "page_size": np.array([_reached(texels, log_side) for texels in used or [1]], np.int32),
    }
    return places, np.array(pages or [0], np.int32)


def texel_count(sides: np.ndarray) -> int:
    """Texels along the curve that charts (T, 2) take."""
    counts = np.bincount(_classes(sides), minlength=256).reshape(16, 16)
    return sum(_taken(15 - row, counts[row]) for row in np.flatnonzero(counts.any(axis=1)).tolist())


def _along_curve(
    members: np.ndarray, sides: np.ndarray, place: np.ndarray, stacked: np.ndarray, kind: np.ndarray, start: int
) -> int:
    """Fill place, stacked and kind of triangles in the order of their classes, from `start` on; returns their
    texels.
    """
    classes = _classes(sides[members])
    counts = np.bincount(classes, minlength=256).reshape(16, 16)
    before, first = start, 0
    for row in np.flatnonzero(counts.any(axis=1)).tolist():
        width, bottom = 15 - row, 0  # bottom of the next rectangle in a stack of squares
        for column in np.flatnonzero(counts[row]).tolist():
            height, count = 15 - column, int(counts[row, column])
            part, number = members[first : first + count], np.arange(count)
            first += count
            if width == 0:
                place[part] = before + number
                break
            at = bottom + ((number >> 1) << height)
            place[part] = before + ((at >> width) << (2 * width))
            stacked[part] = at & ((1 << width) - 1)
            kind[part] = number & 1
            bottom += (count + 1) // 2 << height
        before += _taken(width, counts[row])
    return before - start


def _taken(width: int, counts: np.ndarray) -> int:
    """Texels of the curve under rectangles 2^width wide; the last square may be half used.

    counts: (16,) triangles by 15 - log2 of the height.
    """
    if width == 0:
        return int(counts[15])
    pile = sum((int(count) + 1) // 2 << (15 - column) for column, count in enumerate(counts))
    full, rest = pile >> width, pile & ((1 << width) - 1)
    halves = 0 if rest == 0 else (1 if rest <= 1 << (width - 1) else 2)
    return (2 * full + halves) << (2 * width - 1)


def _classes(sides: np.ndarray) -> np.ndarray:
    """(T,) uint8, ascending with falling width, then falling height; the last class is that of single texels."""
    return ((15 - sides[:, 0]) * 16 + (15 - sides[:, 1])).astype(np.uint8)


def _reached(texels: int, log_side: int) -> tuple[int, int]:
    """Width and height of the used part of a page: the page, its lower half, a quarter, ..."""
    while log_side and texels <= 1 << (2 * log_side - 2):
        log_side -= 1
    half = log_side > 0 and texels <= 1 << (2 * log_side - 1)
    return 1 << log_side, 1 << (log_side - half)
