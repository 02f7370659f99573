# SPDX-License-Identifier: GPL-3.0-or-later
"""Heatmaps of priority in colours with a legend, the red overlay, errors before and after refinement.

All arrays are (H, W) or (H, W, 3), row 0 at the bottom, colours sRGB-encoded float32 in [0, 1].
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..runtime.quantities import error_text
from .colormaps import colormap, red_ramp
from .pixel_font import GLYPH_HEIGHT, draw_text, text_width
from .tone import gray

VIEW_HEIGHT_PX = 540  # small pictures are magnified by a whole factor to about this height
_PAPER = 0.11  # sRGB value of the legend's background
_INK = 0.9
_GAP_PX = 8
_DIMMED = 0.35


def magnify(picture: np.ndarray) -> np.ndarray:
    """Magnify `picture` by a whole factor to about 540 rows; larger ones are unchanged."""
    factor = _magnification(picture.shape[0])
    return picture.repeat(factor, axis=0).repeat(factor, axis=1)


def _magnification(rows: int) -> int:
    return max(1, round(VIEW_HEIGHT_PX / rows))


def heatmap(
    priority: np.ndarray, maximum: float, quantity: str, *, map_name: str = "viridis", title: str = ""
) -> np.ndarray:
    """Priority (H, W) in colours, magnified, with a legend from 0 to `maximum` below.

    `maximum` is configured, not the picture's own, so that pictures can be compared; larger values are clamped to it.
    """
    view = magnify(colormap(priority / np.float32(maximum), map_name))
    ticks = [f"{maximum * share:.3g}" for share in (0.0, 0.25, 0.5, 0.75, 1.0)]
    return with_legend([view], [title or "priority"], lambda position: colormap(position, map_name), ticks, quantity)


def overlay(luminance: np.ndarray, urgency: np.ndarray, budget: str, *, title: str = "") -> np.ndarray:
    """Picture (H, W) with the pixels of a budget in red; redder ones are refined first (methods 3).

    `urgency`: (H, W), 1 for the first pixel, falling to 0 at the budget's end and beyond. `budget`: in words.
    """
    ticks = ["last", "", "", "", "first"]
    label = f"refined with {budget}"
    return with_legend([magnify(tint(luminance, urgency))], [title or "refinement order"], red_ramp, ticks, label)


def tint(luminance: np.ndarray, urgency: np.ndarray) -> np.ndarray:
    """Overlay alone, (H, W, 3), not magnified."""
    weight = np.where(urgency > 0, 0.35 + 0.6 * urgency, 0.0).astype(np.float32)[..., None]
    return gray(luminance) * (1 - weight) + red_ramp(urgency) * weight


def error_picture(
    before: np.ndarray,
    after: np.ndarray,
    maximum: float,
    mse: tuple[float, float],
    *,
    map_name: str = "viridis",
    unrefined: str = "preview",
) -> np.ndarray:
    """Absolute luminance errors (H, W) of the picture called `unrefined` and of the refined one, side by side."""
    views = [magnify(colormap(error / np.float32(maximum), map_name)) for error in (before, after)]
    titles = [f"{name}: error {error_text(value)}" for name, value in zip((unrefined, "refined"), mse, strict=True)]
    ticks = [f"{maximum * share:.3g}" for share in (0.0, 0.25, 0.5, 0.75, 1.0)]
    legend = "luminance error (above: squared x 10,000)"
    return with_legend(views, titles, lambda position: colormap(position, map_name), ticks, legend)


def with_legend(
    views: list[np.ndarray],
    titles: list[str],
    ramp: Callable[[np.ndarray], np.ndarray],
    ticks: list[str],
    quantity: str,
) -> np.ndarray:
    """Views side by side under their titles, above one bar of colours with ticks and the name of the quantity."""
    gap, width = _GAP_PX, sum(view.shape[1] for view in views) + _GAP_PX * (len(views) - 1)
    scale = 2 if max(text_width(text) for text in (*titles, quantity)) * 2 + 16 <= views[0].shape[1] else 1
    line = GLYPH_HEIGHT * scale
    (foot, head), height = _margins(scale), views[0].shape[0]
    page = np.full((foot + height + head, width, 3), _PAPER, np.float32)
    left = 0
    for view, title in zip(views, titles, strict=True):
        page[foot : foot + height, left : left + view.shape[1]] = view
        draw_text(page, title, left + gap, foot + height + gap, scale, _INK)
        left += view.shape[1] + gap
    _draw_bar(page, ramp, ticks, gap, 3 * gap + 2 * line - scale, 6 * scale, scale)
    draw_text(page, quantity, (width - text_width(quantity) * scale) // 2, gap, scale, _INK)
    return page


def places_on_page(
    page_px: tuple[int, int], size_px: tuple[int, int], count: int
) -> tuple[tuple[float, float, float, float], ...]:
    """Rectangles of `count` pictures of size_px (width, height) on a page of `with_legend`.

    In shares of the page's sides: left, bottom, right, top. Empty if the page has another size.
    """
    factor = _magnification(size_px[1])
    width, height = size_px[0] * factor, size_px[1] * factor
    if page_px[0] != count * width + (count - 1) * _GAP_PX:
        return ()
    for foot, head in (_margins(1), _margins(2)):
        if foot + height + head == page_px[1]:
            lefts = [index * (width + _GAP_PX) for index in range(count)]
            sides = foot / page_px[1], (foot + height) / page_px[1]
            return tuple((left / page_px[0], sides[0], (left + width) / page_px[0], sides[1]) for left in lefts)
    return ()


def _margins(scale: int) -> tuple[int, int]:
    """Rows below and above the pictures on a page, for its legend and its titles."""
    line = GLYPH_HEIGHT * scale
    return 4 * _GAP_PX + 2 * line + 8 * scale, line + 2 * _GAP_PX


def _draw_bar(
    page: np.ndarray,
    ramp: Callable[[np.ndarray], np.ndarray],
    ticks: list[str],
    margin: int,
    bottom: int,
    thickness: int,
    scale: int,
) -> None:
    """Draw a horizontal bar of colours at row `bottom`, with evenly spaced ticks and their labels; none if narrow."""
    width = page.shape[1] - 2 * margin
    if width < 2:
        return
    page[bottom + scale * 2 : bottom + scale * 2 + thickness, margin : margin + width] = ramp(np.linspace(0, 1, width))
    for index, label in enumerate(ticks):
        x = margin + round(index / (len(ticks) - 1) * (width - 1))
        page[bottom : bottom + scale * 2, max(x - scale // 2, 0) : x + 1] = _INK
        half = text_width(label) * scale // 2
        start = min(max(x - half, margin), margin + width - 2 * half)
        draw_text(page, label, start, bottom - (GLYPH_HEIGHT + 1) * scale, scale, _INK)
