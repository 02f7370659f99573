# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels of figures: pictures without axes, and figures saved as .png and .svg."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..benchmarks.figures import save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ENDINGS = (".png", ".svg")


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


def save_panels(figure: Figure, folder: Path, name: str) -> list[Path]:
    """Write a figure as `name` with each of ENDINGS; returns the files, raises PatchNetError if one cannot be."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"{name}{ending}" for ending in ENDINGS]
    for path in paths:
        save_figure(figure, path)
    return paths
