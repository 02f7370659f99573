# SPDX-License-Identifier: GPL-3.0-or-later
"""Figures of an evaluation: error over budget and over total time, and the matrix of generalisation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from .costs import CYCLES_MS_PER_PIXEL, total_ms
from .panels import BLUE, GRAY, GREEN, ORANGE, PURPLE, save_panels
from .strategies import network_name

_LIGHT = "0.75"
Style = tuple[str, str]  # color and line
_STYLES: dict[str, Style] = {
    "patchnet-plus": ("black", "-"), "patchnet-plus-1": ("#b2182b", "-"), "patchnet-plus-0": ("#888800", "-"),
    "plain-plus-4": ("black", "--"), "plain-plus-1": ("#b2182b", "--"), "plain-plus-0": ("#888800", "--"),
    "patchnet": ("#56b4e9", "-"), "patchnet-behind": (BLUE, "-"), "fusion": (PURPLE, "-"), "ss-variance": (ORANGE, "-"),
    "ws-lut": (GREEN, "-"), "fine-ray": ("#8c510a", "-"), "fine-ray-variance": ("#8c510a", "--"),
    "fine-rays-4": ("#cc79a7", "-"), "fine-rays-4-variance": ("#cc79a7", "--"), "patchnet-behind-exact": (BLUE, ":"),
    "patchnet-exact": ("#56b4e9", ":"), "witw20": ("#332288", ":"), "kkr18": ("#332288", "--"),
    "ss-unet": ("#332288", "-"),
}  # fmt: skip
# Of the first further networks; later ones are gray.
_NETWORK_STYLES = (("black", "-."), ("#e69f00", "-."), ("#882255", "-."), ("#999933", "-."))
_COLUMNS = 5  # of the overview
_PANELS = (
    (range(1, 2), "no further ray"),
    (range(2, 3), "one further ray"),
    (range(3, 9), "four or five further rays"),
)
GENERALISATION = "generalisation"  # name of its files
_COLORS = "RdBu_r"  # blue is below 1, red above; safe for color vision deficiency
_WIDEST = 10.0  # the scale spans 1/10 to 10
_LABEL = {"boxstyle": "round", "facecolor": "white", "alpha": 0.6, "linewidth": 0}
_CELL, _MARGIN = 0.72, 2.2  # inches


def draw_budgets(
    values: dict[str, Any], folder: Path, name: str, title: str, levels: Mapping[str, float] | None = None
) -> list[Path]:
    """Draw error over budget of a scene, a diagram for each number of rays per pixel, with optimal and random.

    The first four further networks have their own lines. levels: errors that do not depend on strategies, as horizontal
    lines, by label. Returns the files.
    """
    figure = Figure(figsize=(12, 5), dpi=100, layout="constrained")
    figure.suptitle(title, fontsize=12)
    panels = figure.subplots(1, len(_PANELS), sharey=True)
    styles = _STYLES | network_styles(values["mse"])
    for axes, (rays, label) in zip(panels, _PANELS, strict=True):
        strategies = [strategy for strategy in values["mse"] if values["rays_per_pixel"][strategy] in rays]
        _draw_scene(axes, values, strategies, styles)
        for number, (label_of_level, level) in enumerate((levels or {}).items()):
            axes.axhline(1e4 * level, color="k", lw=0.8, ls=("-.", (0, (1, 3)))[number % 2], label=label_of_level)
        axes.set(xlabel="refined (% of active pixels)", title=label)
        axes.legend(fontsize=8, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2)
    panels[0].set_ylabel("mean squared error (1e-4)")
    return save_panels(figure, folder, name)


def draw_overview(scenes: Mapping[str, Any], folder: Path, name: str) -> list[Path]:
    """Draw error over budget of all scenes, a diagram each, with the highlighted strategies; returns the files."""
    rows = -(-len(scenes) // _COLUMNS)
    figure = Figure(figsize=(3.2 * _COLUMNS, 2.9 * rows + 0.8), dpi=100, layout="constrained")
    panels = figure.subplots(rows, _COLUMNS, squeeze=False, sharex=True).ravel()
    for axes, (scene, values) in zip(panels, scenes.items(), strict=False):
        _draw_scene(axes, values, [strategy for strategy in values["mse"] if strategy in _STYLES], _STYLES)
        axes.set_title(scene)
    for axes in panels[len(scenes) :]:
        axes.set_axis_off()
    for axes in panels[-_COLUMNS:]:
        axes.set_xlabel("refined (% of active pixels)")
    figure.supylabel("mean squared error (1e-4)", fontsize=10)
    labels = panels[0].get_legend_handles_labels()
    figure.legend(*labels, fontsize=9, frameon=False, loc="outside lower center", ncols=7)
    return save_panels(figure, folder, name)


def draw_times(values: dict[str, Any], folder: Path, name: str, title: str) -> list[Path]:
    """Draw mean squared error over the total time of a frame: the strategy and its refinement samples.

    Left, samples are 32x32 rays of the octree in each refined pixel; right, 64 paths of Cycles at a stated cost.
    Pictures with the same number of rays in every pixel are points. Returns the files.
    """
    figure = Figure(figsize=(12, 5.2), dpi=100, layout="constrained")
    figure.suptitle(title, fontsize=12)
    left, right = figure.subplots(1, 2, sharey=True)
    prices = ((left, values["reference_ms_per_pixel"], "samples: 32 x 32 rays"),
              (right, CYCLES_MS_PER_PIXEL, f"samples: Cycles, {CYCLES_MS_PER_PIXEL:g} ms a pixel"))  # fmt: skip
    for axes, price, label in prices:
        for strategy in values["ms_per_frame"]:
            _draw_curve(axes, total_ms(values, strategy, price), _error(values["mse"][strategy]), strategy, _STYLES)
        axes.set(xlabel="milliseconds a frame, one thread", title=label, yscale="log", xscale="log")
        axes.set_ylim(values["mse"]["random"][0] * 1e4 / 300, values["mse"]["random"][0] * 1.2e4)
        _finish(axes)
    for kind, marker, size, label in (
        ("uniform", "k^", 6, "1, 2x2, 3x3, 4x4 rays in each pixel"),
        ("predicted", "k*", 9, "predicted pictures, unrefined"),
    ):
        found = [(picture["ms_per_frame"], 1e4 * picture["mse"]) for picture in values[kind].values()]
        left.plot(*zip(*found, strict=True), marker, ms=size, label=label)
    labels = left.get_legend_handles_labels()
    figure.legend(*labels, fontsize=8, frameon=False, loc="outside lower center", ncols=6)
    left.set_ylabel("mean squared error (1e-4)")
    return save_panels(figure, folder, name)


def _draw_scene(axes: Axes, values: Mapping[str, Any], strategies: Iterable[str], styles: Mapping[str, Style]) -> None:
    """Draw error over budget of strategies, with random and optimal."""
    budgets = 100 * np.asarray(values["budgets"])
    for kind, style in (("random", "--"), ("optimal", ":")):
        axes.plot(budgets, _error(values["mse"][kind]), style, color=GRAY, lw=1, label=kind)
    for strategy in strategies:
        if strategy not in ("random", "optimal"):
            _draw_curve(axes, budgets, _error(values["mse"][strategy]), strategy, styles)
    axes.set_yscale("log")
    axes.set_ylim(values["mse"]["random"][0] * 1e4 / 200, values["mse"]["random"][0] * 1.2e4)
    _finish(axes)


def _finish(axes: Axes) -> None:
    """Set grid and frame; the figure has the legend."""
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)


def network_styles(strategies: Iterable[str]) -> dict[str, Style]:
    """Color and line of the strategies of the first four further networks, one per network."""
    networks = {strategy: name for strategy in strategies if (name := network_name(strategy)) is not None}
    styles = dict(zip(dict.fromkeys(networks.values()), _NETWORK_STYLES, strict=False))
    return {strategy: styles[name] for strategy, name in networks.items() if name in styles}


def _error(curve: list[float]) -> np.ndarray:
    """Errors in 1e-4; NaN for 0 at budget 1, which a log scale cannot show."""
    error = 1e4 * np.asarray(curve)
    return np.where(error > 0, error, np.nan)


def _draw_curve(axes: Axes, x: np.ndarray, error: np.ndarray, strategy: str, styles: Mapping[str, Style]) -> None:
    if strategy in styles:
        color, style = styles[strategy]
        axes.plot(x, error, style, color=color, lw=1.8, label=strategy, zorder=3)
        return
    label, style = ("other scores", "-") if network_name(strategy) is None else ("other networks", "-.")
    if label in axes.get_legend_handles_labels()[1]:
        label = "_hidden"
    axes.plot(x, error, style, color=_LIGHT, lw=0.9, zorder=1, label=label)


def draw_generalisation(found: Mapping[str, Any], folder: Path) -> list[Path]:
    """Draw the matrices of `generalisation_of`, networks in the given order; bold where a scene was in training.

    Returns the files, none without networks; raises PatchNetError if one cannot be written.
    """
    if not found:
        return []
    rows = list(next(iter(found.values())))
    scenes = list(next(iter(found.values()))[rows[0]])
    size = 2 * _CELL * len(scenes) + 2 * _MARGIN, _CELL * len(rows) * 0.7 + _MARGIN
    figure = Figure(figsize=(max(size[0], 7.5), size[1]), dpi=100, layout="constrained")
    panels = figure.subplots(1, len(found), sharey=True, squeeze=False)[0]
    for axes, (score, cells) in zip(panels, found.items(), strict=True):
        grid = np.array([[cells[row][scene]["value"] for scene in scenes] for row in rows], np.float64)
        image = axes.imshow(grid, cmap=_COLORS, norm=LogNorm(1 / _WIDEST, _WIDEST), aspect="auto")
        for (row, column), value in np.ndenumerate(grid):
            weight = "bold" if cells[rows[row]][scenes[column]]["seen"] else "normal"
            axes.text(column, row, f"{value:.2f}", ha="center", va="center", weight=weight, bbox=_LABEL)
        axes.set_xticks(range(len(scenes)), scenes, rotation=35, ha="right")
        axes.set_yticks(range(len(rows)), rows)
        axes.set(xlabel="tested on", title=f"score of {score}")
    panels[0].set_ylabel("trained on")
    figure.colorbar(image, ax=list(panels), shrink=0.9, label="error at 30 % over that of ss-variance")
    return save_panels(figure, folder, GENERALISATION)
