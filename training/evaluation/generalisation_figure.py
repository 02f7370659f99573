# SPDX-License-Identifier: GPL-3.0-or-later
"""Figure of generalisation: a matrix for each score, rows by what a network was trained on, columns by the test."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .network_names import WITHOUT
from .panels import save_panels

if TYPE_CHECKING:
    from matplotlib.axes import Axes

NAME = "generalisation"
_COLORS = "RdBu_r"  # blue is below 1, red above; told apart also without colour vision
_LEAST_RANGE = 2.0  # the scale goes at least from 1/2 to 2
_CELL, _MARGIN = 0.72, 2.2  # inches


def draw_generalisation(found: Mapping[str, Any], folder: Path) -> list[Path]:
    """Draw the matrices of `generalisation_of`; cells are outlined where row and column name one scene.

    Returns the files, none if there are no networks; raises PatchNetError if one cannot be written.
    """
    from matplotlib.colors import LogNorm
    from matplotlib.figure import Figure

    matrices = {score: values["networks"] for score, values in found.items() if values["networks"]}
    if not matrices:
        return []
    scenes = list(next(iter(next(iter(matrices.values())).values())))
    rows = ordered_rows(list(next(iter(matrices.values()))), scenes)
    grids = {score: _grid(cells, rows, scenes) for score, cells in matrices.items()}
    there = np.concatenate([grid[np.isfinite(grid) & (grid > 0)] for grid in grids.values()])
    widest = float(np.exp(np.abs(np.log(there)).max(initial=np.log(_LEAST_RANGE))))
    norm = LogNorm(1 / widest, widest)
    size = (2 * _CELL * len(scenes) + 2 * _MARGIN, _CELL * len(rows) * 0.7 + _MARGIN)
    figure = Figure(figsize=(max(size[0], 7.5), size[1]), dpi=100, layout="constrained")
    panels = figure.subplots(1, len(grids), sharey=True, squeeze=False)[0]
    for axes, (score, grid) in zip(panels, grids.items(), strict=True):
        image = axes.imshow(grid, cmap=_COLORS, norm=norm, aspect="auto")
        _label(axes, grid, image, rows, scenes)
        axes.set_title(f"score of {score}", fontsize=11)
    panels[0].set_ylabel("trained on")
    bar = figure.colorbar(image, ax=list(panels), shrink=0.9, pad=0.02)
    bar.set_label("error at 30 % over that of ss-variance")
    _plain_ticks(bar, widest)
    return save_panels(figure, folder, NAME)


def ordered_rows(networks: Sequence[str], scenes: Sequence[str]) -> list[str]:
    """Networks of one scene, then those without one, each in the order of the scenes, so that both have a diagonal."""
    wanted = [*scenes, *(WITHOUT + scene for scene in scenes)]
    others = [name for name in networks if name not in wanted]
    alone = [name for name in wanted[: len(scenes)] if name in networks]
    alone += [name for name in others if not name.startswith(WITHOUT)]
    return [
        *alone,
        *(name for name in wanted[len(scenes) :] if name in networks),
        *(name for name in others if name.startswith(WITHOUT)),
    ]


def row_title(network: str) -> str:
    """What a network was trained on, in words."""
    return f"all but {network.removeprefix(WITHOUT)}" if network.startswith(WITHOUT) else network


def _grid(cells: Mapping[str, Any], rows: Sequence[str], scenes: Sequence[str]) -> np.ndarray:
    """Ratios (rows, scenes) float64, NaN where there is none."""
    values = [[cells[row][scene]["value"] for scene in scenes] for row in rows]
    return np.array([[np.nan if value is None else value for value in line] for line in values], np.float64)


def _label(axes: Axes, grid: np.ndarray, image: Any, rows: Sequence[str], scenes: Sequence[str]) -> None:
    """Write the cells' numbers, the names of rows and columns, and outline the diagonals."""
    from matplotlib.patches import Rectangle

    axes.set_xticks(range(len(scenes)), scenes, rotation=35, ha="right")
    axes.set_yticks(range(len(rows)), [row_title(row) for row in rows])
    axes.set_xlabel("tested on")
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    alone = sum(not row.startswith(WITHOUT) for row in rows)
    if 0 < alone < len(rows):
        axes.axhline(alone - 0.5, color="white", lw=5)
    for (row, column), value in np.ndenumerate(grid):
        text = f"{value:.2f}" if np.isfinite(value) else "none"
        red, green, blue, _ = image.cmap(image.norm(value)) if np.isfinite(value) else (1.0, 1.0, 1.0, 1.0)
        ink = "black" if 0.2126 * red + 0.7152 * green + 0.0722 * blue > 0.5 else "white"
        axes.text(column, row, text, ha="center", va="center", fontsize=9, color=ink)
        if rows[row].removeprefix(WITHOUT) == scenes[column]:
            style = "--" if rows[row].startswith(WITHOUT) else "-"
            axes.add_patch(Rectangle((column - 0.46, row - 0.42), 0.92, 0.84, fill=False, color=ink, lw=1.6, ls=style))


def _plain_ticks(bar: Any, widest: float) -> None:
    """Ticks such as 0.5, 1, 2 on the colour scale."""
    ticks = [tick for tick in (0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0) if 1 / widest <= tick <= widest]
    bar.set_ticks(ticks, labels=[f"{tick:g}" for tick in ticks])
    bar.ax.minorticks_off()
