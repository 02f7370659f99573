# SPDX-License-Identifier: GPL-3.0-or-later
"""Figure of a split rendering: stripes, crops, and the order in which strategies refine (Fig. 2 of the paper)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ....patchnet_addon.image.tone import gray
from ...benchmarks.figures import BLUE, ORANGE
from ..panels import save_panels, show_picture
from ..patterns import PATTERN_BUDGET, pattern
from .split import OTHER, OURS, PREVIEW, REFERENCE, SplitView, found_share

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

_TITLES = {PREVIEW: "one ray a pixel", REFERENCE: "32 x 32 rays"}
_COLORS = (BLUE, ORANGE)
_INCHES = 11.0
_WIDE = 0.5  # of it for the stripes, the rest for crops


def draw_split(view: SplitView, folder: Path, name: str, title: str) -> list[Path]:
    """Draw a view; returns the files, raises PatchNetError if one cannot be written."""
    from matplotlib.figure import Figure

    rows, columns = view.bounds
    aspect = (rows.stop - rows.start) / (columns.stop - columns.start)
    wide, small = _WIDE * _INCHES, _INCHES / 3
    heights = (max(wide * aspect + 0.5, 0.3 * _INCHES), 2 * (small * aspect + 0.3))
    figure = Figure(figsize=(_INCHES, sum(heights) + 0.3), dpi=150, layout="constrained")
    figure.suptitle(title, fontsize=11)
    parts: Any = figure.subfigures(2, 1, height_ratios=heights)
    above, below = parts
    left, right = above.subfigures(1, 2, width_ratios=(_WIDE, 1.0 - _WIDE))
    _draw_stripes(left.subplots(), view)
    _draw_crops(right, view)
    _draw_patterns(below, view)
    return save_panels(figure, folder, name)


def _draw_stripes(axes: Axes, view: SplitView) -> None:
    """Stripes with lines between them and their names below, and frames around the crops."""
    from matplotlib.patches import Rectangle

    stripes = view.stripes()
    height, width = stripes.shape[:2]
    show_picture(axes, stripes, f"{PATTERN_BUDGET:.0%} of the pixels refined", interpolation="antialiased")
    for number, name in enumerate(view.pictures):
        middle = (number + 0.5) * width / len(view.pictures)
        axes.text(middle, height * 1.01, _TITLES.get(name, name), fontsize=8, ha="center", va="top")
        if number:
            axes.axvline(number * width / len(view.pictures) - 0.5, color="w", lw=0.8)
    rows, columns = view.bounds
    for crop, color in zip(view.crops, _COLORS, strict=True):
        corner = crop.column - columns.start - 0.5, rows.stop - crop.row - crop.side - 0.5
        axes.add_patch(Rectangle(corner, crop.side, crop.side, fill=False, ec=color, lw=1.5))


def _draw_crops(figure: SubFigure, view: SplitView) -> None:
    """Crops of all pictures, a row each, in a frame of its colour."""
    rows: Any = figure.subfigures(2, 1)
    for row, crop, color, better, worse in zip(rows, view.crops, _COLORS, (OURS, OTHER), (OTHER, OURS), strict=True):
        row.suptitle(f"where {better} is ahead of {worse} by most", fontsize=9)
        panels = row.subplots(1, len(view.pictures))
        for axes, (name, picture) in zip(panels, view.pictures.items(), strict=True):
            show_picture(axes, gray(picture[crop.slices]), _TITLES.get(name, name))
            axes.title.set_fontsize(8)
            axes.set_axis_on()
            axes.set(xticks=[], yticks=[])
            for spine in axes.spines.values():
                spine.set(color=color, lw=1.5)


def _draw_patterns(figure: Figure | SubFigure, view: SplitView) -> None:
    """Refinement patterns, and how much of the squared error each finds."""
    for axes, (name, ranking) in zip(figure.subplots(2, 3).flat, view.rankings.items(), strict=True):
        title = f"{name}: {found_share(*ranking.mse):.0%} of the squared error found"
        show_picture(axes, pattern(ranking)[view.bounds], title, interpolation="antialiased")
