# SPDX-License-Identifier: GPL-3.0-or-later
"""Figure of one object from several distances: true error, and what each look-ahead expects of it (Fig. 4)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ....patchnet_addon.image.tone import gray
from ....patchnet_addon.runtime.bounds import LOOKAHEADS
from ...benchmarks.figures import BLUE, GRAY, GREEN, ORANGE, PURPLE
from ..panels import save_panels, show_picture, show_values
from ..patterns import PATTERN_BUDGET
from .distances import EXACT, NETWORK, PLAIN, DistanceView, named

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_QUANTILE = 0.995  # of the errors that are shown: where the colours end
_COLORS = {1: GREEN, 2: BLUE, 3: PURPLE}
_PANEL = 1.75  # inches
_PICTURES = 3  # beside the scores: preview, reference, error


def draw_look_ahead(
    shown: Sequence[DistanceView],
    values: Sequence[Mapping[str, Any]],
    shown_values: Sequence[Mapping[str, Any]],
    folder: Path,
    name: str,
    title: str,
) -> list[Path]:
    """Draw a row for each shown view, nearest first, and the share of the error that is found over the distance.

    Scores of networks stand in a row of their own below the exact ones of the same look-ahead. values: those of
    `pooled_values` for all distances. shown_values: for each view alone. Returns the files; raises PatchNetError if one
    cannot be written.
    """
    from matplotlib.figure import Figure

    exact, networks = ([name for name in _names(kind[0]) if name in shown[0].scores] for kind in (EXACT, NETWORK))
    rows = 2 if networks else 1  # of a view
    size = _PANEL * (_PICTURES + len(exact)) + 1.4, (_PANEL + 0.3) * rows * len(shown) + 3.6
    figure = Figure(figsize=size, dpi=150, layout="constrained")
    figure.suptitle(title, fontsize=11)
    parts: Any = figure.subfigures(2, 1, height_ratios=(size[1] - 3.3, 3.3))
    above, below = parts
    largest = float(np.quantile(np.concatenate([view.error.ravel() for view in shown]), _QUANTILE)) or 1.0
    grid = above.add_gridspec(rows * len(shown), _PICTURES + len(exact))
    for number, (view, found) in enumerate(zip(shown, shown_values, strict=True)):
        first = rows * number
        pictures = [above.add_subplot(grid[first : first + rows, column]) for column in range(_PICTURES)]
        _draw_pictures(pictures, view, found, largest)
        for row, names in enumerate([exact, _names(NETWORK[0])][:rows]):
            panels = [above.add_subplot(grid[first + row, _PICTURES + column]) for column in range(len(names))]
            _draw_scores(panels, names, view, found, largest)
    above.colorbar(pictures[2].images[0], ax=above.axes, shrink=0.6, label="luminance error, true and expected")
    left, right = below.subplots(1, 2, sharey=True)
    _draw_found(left, values, "region", "pixels of the cloth")
    _draw_found(right, values, "picture", "all pixels")
    left.set_ylabel(f"squared error found\nby {PATTERN_BUDGET:.0%} of the pixels (%)")
    right.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return save_panels(figure, folder, name)


def _names(strategy: str) -> list[str]:
    return [named(strategy, lookahead) for lookahead in LOOKAHEADS]


def _draw_pictures(row: Sequence[Axes], view: DistanceView, found: Mapping[str, Any], largest: float) -> None:
    """Preview, reference, and error."""
    buffers = view.buffers
    assert buffers.reference is not None
    voxel = f"{100 * view.voxel_world:.2g} cm"
    show_picture(row[0], gray(buffers.picture(buffers.preview)), f"{found['distance']:.1f} m, voxels {voxel}")
    show_picture(row[1], gray(buffers.picture(buffers.reference)), "32 x 32 rays")
    show_values(row[2], view.error, largest, "true error")


def _draw_scores(
    row: Sequence[Axes], names: Sequence[str], view: DistanceView, found: Mapping[str, Any], largest: float
) -> None:
    """Scores with what they find; nothing for a look-ahead that no network has."""
    for axes, name in zip(row, names, strict=True):
        if name not in view.scores:
            axes.set_axis_off()
            continue
        kind, lookahead = name.split()
        label = "exact" if kind in EXACT else "network"
        share = found["region"]["strategies"][name]["found"]
        title = f"{label}, {lookahead} ahead: {share:.0%}"
        show_values(axes, view.buffers.picture(view.scores[name]), largest, title)


def _draw_found(axes: Axes, values: Sequence[Mapping[str, Any]], part: str, title: str) -> None:
    """Share of the squared error that is found over the distance, a line for each strategy."""
    distances = [each["distance"] for each in values]

    def draw(name: str, label: str, style: str, color: str) -> None:
        shares = [100 * each[part]["strategies"][name]["found"] for each in values]
        axes.plot(distances, shares, style, color=color, lw=1.6, ms=4, label=label)

    draw(PLAIN[1], "optimal", ":", GRAY)
    for kind, style, label in ((EXACT[0], "o-", "exact"), (NETWORK[0], "s--", "network")):
        for lookahead in reversed(LOOKAHEADS):
            name = named(kind, lookahead)
            if name in values[0][part]["strategies"]:
                ahead = "1 level" if lookahead == 1 else f"{lookahead} levels"
                draw(name, f"{label}, {ahead} ahead", style, _COLORS[lookahead])
    draw(PLAIN[0], PLAIN[0], "--", ORANGE)
    axes.set(xlabel="distance (m)", title=title, xscale="log")
    axes.set_xticks(distances, [f"{distance:.1f}" for distance in distances])
    axes.minorticks_off()
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
