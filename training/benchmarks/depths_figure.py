# SPDX-License-Identifier: GPL-3.0-or-later
"""Figure of the cost of depth: time over fragments, and time per fragment, leaf and triangle over depth."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...patchnet_addon.runtime.errors import PatchNetError, SettingError
from ...patchnet_addon.runtime.file_kinds import PDF, PNG, SVG
from ...patchnet_addon.runtime.outputs import check_outputs
from .depths import DepthCost

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis

_KINDS = {".png": PNG, ".svg": SVG, ".pdf": PDF}
# Told apart also without colour vision (Okabe and Ito).
_BLUE, _ORANGE, _GREEN, _PURPLE, _GRAY = "#0072b2", "#d55e00", "#009e73", "#aa4499", "0.45"


def check_figure(path: Path, inputs: Iterable[Path]) -> None:
    """Raise PatchNetError if a figure could not be drawn to `path`, before anything long is measured.

    inputs: files that are read, and never replaced.
    """
    kind = _KINDS.get(path.suffix.lower())
    if kind is None:
        raise SettingError(f"Figure {path} has an unknown extension: choose one of {', '.join(_KINDS)} for --plot")
    if not path.absolute().parent.is_dir():
        raise SettingError(f"Figure {path} cannot be written: its folder does not exist; make it or change --plot")
    check_outputs({path: kind}, inputs)
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError as cause:
        raise PatchNetError(
            f"Figure {path} cannot be drawn ({cause}): install patchnet-blender[bench], or leave out --plot"
        ) from cause


def draw_depths(costs: Sequence[DepthCost], path: Path, title: str, peer_name: str) -> None:
    """Draw `costs` to `path`, 900 pixels wide; raises PatchNetError if it cannot be written."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 4.2), dpi=100, layout="constrained")
    figure.suptitle(title, fontsize=12)
    left, right = figure.subplots(1, 2)
    _draw_times(left, costs, peer_name)
    _draw_prices(right, costs)
    beside = path.with_name(f".{path.stem}.{secrets.token_hex(4)}{path.suffix}")
    try:
        figure.savefig(beside)
        os.replace(beside, path)
    except OSError as cause:
        raise PatchNetError(
            f"{path} cannot be written: {cause.strerror or cause}; choose another folder or make room"
        ) from cause
    finally:
        beside.unlink(missing_ok=True)


def _draw_times(axes: Axes, costs: Sequence[DepthCost], peer_name: str) -> None:
    """Seconds over fragments, with a line of slope 1 through the deepest depth."""
    fragments, seconds = [cost.fragments for cost in costs], [cost.seconds for cost in costs]
    slope = [seconds[-1] * value / fragments[-1] for value in fragments]
    axes.plot(fragments, slope, "--", color=_GRAY, label="linear (slope 1)")
    peer = [(cost.fragments, cost.peer_seconds) for cost in costs if cost.peer_seconds is not None]
    if peer:
        axes.plot(*zip(*peer, strict=True), "s-", color=_ORANGE, ms=5, label=f"{peer_name}, occupied voxels only")
    axes.plot(fragments, seconds, "o-", color=_BLUE, ms=5, label="PatchNet, whole octree")
    for cost in costs:
        axes.annotate(
            str(cost.depth), (cost.fragments, cost.seconds), (6, -11), textcoords="offset points", color=_BLUE
        )
    axes.set(xscale="log", yscale="log", xlabel="million fragments (numbers: depth)", ylabel="time (s)")
    _plain_numbers(axes.xaxis, 1e-6)
    _plain_numbers(axes.yaxis)
    _finish(axes)


def _draw_prices(axes: Axes, costs: Sequence[DepthCost]) -> None:
    """Nanoseconds per fragment, leaf and triangle over depth."""
    rows: list[dict[str, Any]] = [cost.as_json() for cost in costs]
    depths = [cost.depth for cost in costs]
    for name, style, color in (("triangle", "^-", _GREEN), ("leaf", "D-", _PURPLE), ("fragment", "o-", _BLUE)):
        axes.plot(depths, [row[f"ns_per_{name}"] for row in rows], style, color=color, ms=5, label=f"per {name}")
    axes.set(yscale="log", xlabel="depth", ylabel="time (ns)", xticks=depths)
    _plain_numbers(axes.yaxis)
    _finish(axes)


def _plain_numbers(axis: Axis, scale: float = 1.0) -> None:
    """Ticks 0.1, 1, 10 of a logarithmic axis, and 0.2 and 0.5 between them where it spans little."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axis.get_view_interval()
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 300 * low else (1.0,)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value * scale:,.10g}"))
    axis.set_minor_formatter(NullFormatter())


def _finish(axes: Axes) -> None:
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(fontsize=9, frameon=False, loc="best")
