# SPDX-License-Identifier: GPL-3.0-or-later
"""Figures of an evaluation: error over budget by the number of rays, and error over total time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..benchmarks.figures import BLUE, GRAY, GREEN, ORANGE, PURPLE, finish
from .costs import CYCLES_MS_PER_PIXEL, total_ms
from .panels import save_panels
from .patch_networks import network_name

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LIGHT = "0.75"
Style = tuple[str, str]  # color and line
_STYLES: dict[str, Style] = {
    "patchnet-plus": ("black", "-"), "patchnet-plus-1": ("#b2182b", "-"), "patchnet-plus-0": ("#888800", "-"),
    "plain-plus-4": ("black", "--"), "plain-plus-1": ("#b2182b", "--"), "plain-plus-0": ("#888800", "--"),
    "patchnet": ("#56b4e9", "-"), "patchnet-behind": (BLUE, "-"), "fusion": (PURPLE, "-"), "ss-variance": (ORANGE, "-"),
    "ws-lut": (GREEN, "-"), "fine-ray": ("#8c510a", "-"), "fine-ray-variance": ("#8c510a", "--"),
    "fine-rays-4": ("#cc79a7", "-"), "fine-rays-4-variance": ("#cc79a7", "--"), "patchnet-behind-exact": (BLUE, ":"),
    "patchnet-exact": ("#56b4e9", ":"), "patchnet-plus-staged": ("black", ":"),
    "patchnet-plus-1-staged": ("#b2182b", ":"),
}  # fmt: skip
# For further networks, the first ones that are named; those after them are gray.
_NETWORK_STYLES = (("black", "-."), ("#e69f00", "-."), ("#882255", "-."), ("#999933", "-."))
_COLUMNS = 5  # of the overview
_PANELS = (
    (range(1, 2), "no further ray"),
    (range(2, 3), "one further ray"),
    (range(3, 9), "four or five further rays"),
)


def draw_budgets(
    values: dict[str, Any], folder: Path, name: str, title: str, levels: Mapping[str, float] | None = None
) -> list[Path]:
    """Draw error over budget of a scene, a diagram for each number of rays a pixel, with optimal and random.

    Of further networks the first four have lines of their own. levels: errors that are no strategy's, drawn as level
    lines, by label. Returns the files; raises PatchNetError if one cannot be written.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 5), dpi=100, layout="constrained")
    figure.suptitle(title, fontsize=12)
    budgets = 100 * np.asarray(values["budgets"])
    panels = figure.subplots(1, len(_PANELS), sharey=True)
    styles = _STYLES | network_styles(values["mse"])
    for axes, (rays, label) in zip(panels, _PANELS, strict=True):
        for kind, style in (("random", "--"), ("optimal", ":")):
            axes.plot(budgets, _error(values["mse"][kind]), style, color=GRAY, lw=1, label=kind)
        for number, (label_of_level, level) in enumerate((levels or {}).items()):
            axes.axhline(1e4 * level, color="k", lw=0.8, ls=("-.", (0, (1, 3)))[number % 2], label=label_of_level)
        for strategy, curve in values["mse"].items():
            if values["rays_per_pixel"][strategy] in rays and strategy not in ("random", "optimal"):
                _draw_curve(axes, budgets, _error(curve), strategy, styles)
        axes.set(xlabel="refined (% of active pixels)", title=label, yscale="log")
        axes.set_ylim(values["mse"]["random"][0] * 1e4 / 200, values["mse"]["random"][0] * 1.2e4)
        finish(axes)
        axes.legend(fontsize=8, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2)
    panels[0].set_ylabel("mean squared error (1e-4)")
    return save_panels(figure, folder, name)


def draw_overview(scenes: Mapping[str, Any], folder: Path, name: str) -> list[Path]:
    """Draw error over budget of all scenes, a small diagram each, with the strategies that have lines of their own.

    Returns the files; raises PatchNetError if one cannot be written.
    """
    from matplotlib.figure import Figure

    rows = -(-len(scenes) // _COLUMNS)
    figure = Figure(figsize=(3.2 * _COLUMNS, 2.9 * rows + 0.8), dpi=100, layout="constrained")
    panels = figure.subplots(rows, _COLUMNS, squeeze=False, sharex=True).ravel()
    for axes, (scene, values) in zip(panels, scenes.items(), strict=False):
        budgets = 100 * np.asarray(values["budgets"])
        for kind, style in (("random", "--"), ("optimal", ":")):
            axes.plot(budgets, _error(values["mse"][kind]), style, color=GRAY, lw=1, label=kind)
        for strategy in values["mse"]:
            if strategy in _STYLES:
                _draw_curve(axes, budgets, _error(values["mse"][strategy]), strategy, _STYLES)
        axes.set(title=scene, yscale="log")
        axes.set_ylim(values["mse"]["random"][0] * 1e4 / 200, values["mse"]["random"][0] * 1.2e4)
        finish(axes)
        if axes.get_legend() is not None:
            axes.get_legend().remove()
    for axes in panels[len(scenes) :]:
        axes.set_axis_off()
    for axes in panels[-_COLUMNS:]:
        axes.set_xlabel("refined (% of active pixels)")
    figure.supylabel("mean squared error (1e-4)", fontsize=10)
    figure.legend(
        *panels[0].get_legend_handles_labels(), fontsize=9, frameon=False, loc="outside lower center", ncols=7
    )
    return save_panels(figure, folder, name)


def draw_times(values: dict[str, Any], folder: Path, name: str, title: str) -> list[Path]:
    """Draw mean squared error over the whole time of a frame: what a strategy takes, and the samples that it asks for.

    Left, samples are 32x32 rays of our own in each refined pixel; right, 64 paths of Cycles at a stated price. Pictures
    with as many rays in every pixel are points. Returns the files; raises PatchNetError if one cannot be written.
    """
    from matplotlib.figure import Figure

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
        finish(axes)
        axes.get_legend().remove()
    uniform = values["uniform"].values()
    left.plot(
        [picture["ms_per_frame"] for picture in uniform], [picture["mse"] * 1e4 for picture in uniform],
        "k^", ms=6, label="1, 2x2, 3x3, 4x4 rays in each pixel",
    )  # fmt: skip
    predicted = values["predicted"].values()
    left.plot(
        [picture["ms_per_frame"] for picture in predicted], [picture["mse"] * 1e4 for picture in predicted],
        "k*", ms=9, label="predicted pictures, unrefined",
    )  # fmt: skip
    figure.legend(*left.get_legend_handles_labels(), fontsize=8, frameon=False, loc="outside lower center", ncols=6)
    left.set_ylabel("mean squared error (1e-4)")
    return save_panels(figure, folder, name)


def network_styles(strategies: Iterable[str]) -> dict[str, Style]:
    """Color and line of the strategies of the first four further networks; all strategies of a network have one."""
    networks = {strategy: name for strategy in strategies if (name := network_name(strategy)) is not None}
    styles = dict(zip(dict.fromkeys(networks.values()), _NETWORK_STYLES, strict=False))
    return {strategy: styles[name] for strategy, name in networks.items() if name in styles}


def _error(curve: list[float]) -> np.ndarray:
    """Errors in 1e-4; none at budget 1, which a logarithm cannot show."""
    error = 1e4 * np.asarray(curve)
    return np.where(error > 0, error, np.nan)


def _draw_curve(axes: Axes, x: np.ndarray, error: np.ndarray, strategy: str, styles: Mapping[str, Style]) -> None:
    if strategy in styles:
        color, style = styles[strategy]
        axes.plot(x, error, style, color=color, lw=1.8, label=strategy, zorder=3)
        return
    label, style = ("other scores", "-") if network_name(strategy) is None else ("other networks", "-.")
    axes.plot(x, error, style, color=_LIGHT, lw=0.9, zorder=1, label=_first_of(axes, label))


def _first_of(axes: Axes, label: str) -> str:
    """Label for the first of several curves alone."""
    return "_hidden" if label in axes.get_legend_handles_labels()[1] else label
