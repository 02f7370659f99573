# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures in figures: panels without axes, crops found by rule, and what each strategy refines first of a frame."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ...patchnet_addon.image.heatmap import tint
from ...patchnet_addon.runtime.file_kinds import PNG, SVG
from ...patchnet_addon.runtime.replace import replaced_path
from ...patchnet_addon.sampling.ranking import Ranking

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_KINDS = {".png": PNG, ".svg": SVG}
# Told apart also without colour vision (Okabe and Ito).
BLUE, ORANGE, GREEN, PURPLE, GRAY = "#0072b2", "#d55e00", "#009e73", "#aa4499", "0.45"
PATTERN_BUDGET = 0.3


def show_picture(axes: Axes, picture: np.ndarray, title: str, *, interpolation: str = "nearest") -> None:
    """Show a picture (H, W, 3) whose first row is its lowest, without axes; pixels are squares where it is enlarged.

    interpolation: "antialiased" for pictures that may become smaller.
    """
    axes.imshow(np.clip(picture[::-1], 0.0, 1.0), interpolation=interpolation)
    hide_axes(axes, title)


def show_values(axes: Axes, values: np.ndarray, largest: float, title: str) -> None:
    """Show values (H, W) from 0 to `largest` in colours; the first row is the lowest."""
    axes.imshow(values[::-1], cmap="magma", vmin=0.0, vmax=largest, interpolation="nearest")
    hide_axes(axes, title)


def hide_axes(axes: Axes, title: str) -> None:
    """Leave nothing around a picture but its title."""
    axes.set_title(title, fontsize=9)
    axes.set_axis_off()


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure whole or not at all; raises OutputError if it cannot be written."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with replaced_path(path, _KINDS[path.suffix]) as temporary:
        figure.savefig(temporary, format=path.suffix.removeprefix("."))


def save_panels(figure: Figure, folder: Path, name: str) -> list[Path]:
    """Write a figure as .png and .svg; returns the files, raises OutputError if one cannot be written."""
    paths = [folder / f"{name}{ending}" for ending in _KINDS]
    for path in paths:
        save_figure(figure, path)
    return paths


@dataclass(frozen=True)
class Crop:
    """Square of `side` pixels in a picture; row and column are those of its first pixel, row 0 is the lowest."""

    row: int
    column: int
    side: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """Index of the square in a picture."""
        return slice(self.row, self.row + self.side), slice(self.column, self.column + self.side)


def crops_of_difference(error: np.ndarray, other: np.ndarray, side: int) -> tuple[Crop, Crop]:
    """Two squares that do not overlap: where errors (H, W) are below `other` by most, and where above by most.

    The second is found beside the first. side: in pixels, at most half of the picture's.
    """
    gain = sliding_window_view(np.asarray(other, np.float64) - error, (side, side)).sum(axis=(2, 3))
    first = _at(int(np.argmax(gain)), gain.shape, side)
    rows, columns = np.ogrid[: gain.shape[0], : gain.shape[1]]
    beside = np.maximum(abs(rows - first.row), abs(columns - first.column)) >= side
    second = _at(int(np.argmin(np.where(beside, gain, np.inf))), gain.shape, side)
    return first, second


def _at(index: int, shape: tuple[int, ...], side: int) -> Crop:
    row, column = divmod(index, shape[1])
    return Crop(row, column, side)


def pattern(ranking: Ranking) -> np.ndarray:
    """Preview (H, W, 3) with the pixels that the ranking's budget refines in red, redder is first."""
    buffers = ranking.buffers
    urgency = ranking.urgency(int(np.count_nonzero(ranking.mask)))
    return tint(buffers.picture(buffers.preview), buffers.picture(urgency))
