# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures in figures: panels without axes, automatic crops, and the first refined pixels of each strategy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.lib.stride_tricks import sliding_window_view

from ...patchnet_addon.image.heatmap import tint
from ...patchnet_addon.runtime.file_kinds import PNG
from ...patchnet_addon.runtime.replace import replaced_path
from ...patchnet_addon.sampling.ranking import Ranking
from ..file_kinds import SVG

_KINDS = {".png": PNG, ".svg": SVG}
# Safe for color vision deficiency (Okabe and Ito).
BLUE, ORANGE, GREEN, PURPLE, GRAY = "#0072b2", "#d55e00", "#009e73", "#aa4499", "0.45"
PATTERN_BUDGET = 0.3
Crop = tuple[slice, slice]
"""Rows (0 is the lowest) and columns of a square in a picture."""


def show_picture(axes: Axes, picture: np.ndarray, title: str, *, interpolation: str = "nearest") -> None:
    """Show a picture (H, W, 3), lowest row first, without axes; enlarged pixels are squares, unless interpolated."""
    axes.imshow(np.clip(picture[::-1], 0.0, 1.0), interpolation=interpolation)
    hide_axes(axes, title)


def show_values(axes: Axes, values: np.ndarray, largest: float, title: str) -> None:
    """Show values (H, W), lowest row first, from 0 to `largest` in colors."""
    axes.imshow(values[::-1], cmap="magma", vmin=0.0, vmax=largest, interpolation="nearest")
    hide_axes(axes, title)


def hide_axes(axes: Axes, title: str) -> None:
    """Hide axes and set the title."""
    axes.set_title(title, fontsize=9)
    axes.set_axis_off()


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure atomically; raises OutputError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with replaced_path(path, _KINDS[path.suffix]) as temporary:
        figure.savefig(temporary, format=path.suffix.removeprefix("."))


def save_panels(figure: Figure, folder: Path, name: str) -> list[Path]:
    """Write a figure as .png and .svg; returns the files, raises OutputError."""
    paths = [folder / f"{name}{ending}" for ending in _KINDS]
    for path in paths:
        save_figure(figure, path)
    return paths


def crops_of_difference(error: np.ndarray, other: np.ndarray, side: int) -> tuple[Crop, Crop]:
    """Two disjoint squares: where errors (H, W) are most below `other`, and most above.

    The second is searched beside the first. side: in pixels, at most half of the picture's.
    """
    gain = sliding_window_view(np.asarray(other, np.float64) - error, (side, side)).sum(axis=(2, 3))

    def square(index: int) -> Crop:
        row, column = divmod(index, gain.shape[1])
        return slice(row, row + side), slice(column, column + side)

    first = square(int(np.argmax(gain)))
    rows, columns = np.ogrid[: gain.shape[0], : gain.shape[1]]
    beside = np.maximum(abs(rows - first[0].start), abs(columns - first[1].start)) >= side
    return first, square(int(np.argmin(np.where(beside, gain, np.inf))))


def pattern(ranking: Ranking) -> np.ndarray:
    """Preview (H, W, 3) with the pixels of the ranking's budget in red, first ones most saturated."""
    buffers = ranking.buffers
    urgency = ranking.urgency(int(np.count_nonzero(ranking.mask)))
    return tint(buffers.picture(buffers.preview), buffers.picture(urgency))
