# SPDX-License-Identifier: GPL-3.0-or-later
"""Figure of one frame: what each strategy refines first, and what error it leaves, beside preview and reference."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.image.heatmap import tint
from ...patchnet_addon.image.tone import gray
from ...patchnet_addon.runtime.progress import Steps
from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ...patchnet_addon.sampling.ranking import rank
from ...patchnet_addon.sampling.references.registry import EVALUATED
from ...patchnet_addon.sampling.refine import refined_picture
from ...patchnet_addon.sampling.trace import trace_view
from ...patchnet_addon.tracing.camera import Camera
from ..benchmarks.figures import save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PATTERN_STRATEGIES = ("patchnet", "patchnet-behind", "ss-variance", "ws-lut", "fine-ray", "fine-rays-4", "optimal")
PATTERN_BUDGET = 0.3
_ENDINGS = (".png", ".svg")


def draw_patterns(
    coded: CodedOctree, camera: Camera, folder: Path, name: str, strategies: Sequence[str] = PATTERN_STRATEGIES
) -> Steps[list[Path]]:
    """Draw what PATTERN_BUDGET refines of a frame, red is first, and the absolute errors that are left (Fig. 2).

    Returns the files; raises PatchNetError if one cannot be written.
    """
    from matplotlib.figure import Figure

    chosen = [EVALUATED[strategy] for strategy in strategies]
    buffers = yield from trace_view(coded.octree, camera, chosen, coded=coded)
    assert buffers.reference is not None
    figure = Figure(figsize=(2.1 * (len(chosen) + 1), 4.8), dpi=100, layout="constrained")
    above, below = figure.subplots(2, len(chosen) + 1)
    largest = float(np.abs(buffers.preview - buffers.reference).max()) or 1.0
    _show(above[0], gray(buffers.picture(buffers.preview)), "one ray a pixel")
    _show(below[0], gray(buffers.picture(buffers.reference)), "32 x 32 rays")
    for axes, error_axes, strategy in zip(above[1:], below[1:], chosen, strict=True):
        ranking = rank(strategy, buffers, PATTERN_BUDGET)
        urgency = ranking.urgency(int(np.count_nonzero(ranking.mask)))
        _show(axes, tint(buffers.picture(buffers.preview), buffers.picture(urgency)), strategy.name)
        before, after = ranking.mse
        error = np.abs(_picture(buffers, ranking.mask) - buffers.picture(buffers.reference))
        error_axes.imshow(error[::-1], cmap="magma", vmin=0.0, vmax=largest, interpolation="nearest")
        _show(error_axes, None, f"{1e4 * after:.1f} of {1e4 * before:.1f} e-4")
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"{name}{ending}" for ending in _ENDINGS]
    for path in paths:
        save_figure(figure, path)
    return paths


def _picture(buffers: PixelBuffers, mask: np.ndarray) -> np.ndarray:
    return buffers.picture(refined_picture(buffers, mask))


def _show(axes: Axes, picture: np.ndarray | None, title: str) -> None:
    """Show a picture whose first row is its lowest, without axes."""
    if picture is not None:
        axes.imshow(np.clip(picture[::-1], 0.0, 1.0), interpolation="nearest")
    axes.set_title(title, fontsize=9)
    axes.set_axis_off()
