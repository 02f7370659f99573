# SPDX-License-Identifier: GPL-3.0-or-later
"""Figure of the cost of depth: time over fragments, and time per fragment, leaf and triangle over depth."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .depths import DepthCost
from .figures import BLUE, GRAY, GREEN, ORANGE, PURPLE, finish, plain_numbers, save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw_depths(costs: Sequence[DepthCost], path: Path, title: str, peer_name: str) -> None:
    """Draw `costs` to `path`, 900 pixels wide; raises PatchNetError if it cannot be written."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 4.2), dpi=100, layout="constrained")
    figure.suptitle(title, fontsize=12)
    left, right = figure.subplots(1, 2)
    _draw_times(left, costs, peer_name)
    _draw_prices(right, costs)
    save_figure(figure, path)


def _draw_times(axes: Axes, costs: Sequence[DepthCost], peer_name: str) -> None:
    """Seconds over fragments, with a line of slope 1 through the deepest depth."""
    fragments, seconds = [cost.fragments for cost in costs], [cost.seconds for cost in costs]
    slope = [seconds[-1] * value / fragments[-1] for value in fragments]
    axes.plot(fragments, slope, "--", color=GRAY, label="linear (slope 1)")
    peer = [(cost.fragments, cost.peer_seconds) for cost in costs if cost.peer_seconds is not None]
    if peer:
        axes.plot(*zip(*peer, strict=True), "s-", color=ORANGE, ms=5, label=f"{peer_name}, occupied voxels only")
    axes.plot(fragments, seconds, "o-", color=BLUE, ms=5, label="PatchNet, whole octree")
    for cost in costs:
        axes.annotate(str(cost.depth), (cost.fragments, cost.seconds), (6, -11), textcoords="offset points", color=BLUE)
    axes.set(xscale="log", yscale="log", xlabel="million fragments (numbers: depth)", ylabel="time (s)")
    plain_numbers(axes.xaxis, 1e-6)
    plain_numbers(axes.yaxis)
    finish(axes)


def _draw_prices(axes: Axes, costs: Sequence[DepthCost]) -> None:
    """Nanoseconds per fragment, leaf and triangle over depth."""
    rows: list[dict[str, Any]] = [cost.as_json() for cost in costs]
    depths = [cost.depth for cost in costs]
    for name, style, color in (("triangle", "^-", GREEN), ("leaf", "D-", PURPLE), ("fragment", "o-", BLUE)):
        axes.plot(depths, [row[f"ns_per_{name}"] for row in rows], style, color=color, ms=5, label=f"per {name}")
    axes.set(yscale="log", xlabel="depth", ylabel="time (ns)", xticks=depths)
    plain_numbers(axes.yaxis)
    finish(axes)
