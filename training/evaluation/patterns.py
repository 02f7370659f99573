# SPDX-License-Identifier: GPL-3.0-or-later
"""Figure of one frame: what each strategy refines first, and what error it leaves, beside preview and reference."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.image.heatmap import tint
from ...patchnet_addon.image.tone import gray
from ...patchnet_addon.runtime.progress import Steps
from ...patchnet_addon.sampling.ranking import Ranking, rank
from ...patchnet_addon.sampling.refine import refined_picture
from ...patchnet_addon.sampling.trace import trace_view
from ...patchnet_addon.tracing.camera import Camera
from ..strategies.registry import EVALUATED
from .panels import save_panels, show_picture, show_values

PATTERN_STRATEGIES = ("patchnet", "patchnet-behind", "ss-variance", "ws-lut", "fine-ray", "fine-rays-4", "optimal")
PATTERN_BUDGET = 0.3


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
    show_picture(above[0], gray(buffers.picture(buffers.preview)), "one ray a pixel")
    show_picture(below[0], gray(buffers.picture(buffers.reference)), "32 x 32 rays")
    for axes, error_axes, strategy in zip(above[1:], below[1:], chosen, strict=True):
        ranking = rank(strategy, buffers, PATTERN_BUDGET)
        show_picture(axes, pattern(ranking), strategy.name)
        before, after = ranking.mse
        error = np.abs(refined_picture(buffers, ranking.mask) - buffers.reference)
        show_values(error_axes, buffers.picture(error), largest, f"{1e4 * after:.1f} of {1e4 * before:.1f} e-4")
    return save_panels(figure, folder, name)


def pattern(ranking: Ranking) -> np.ndarray:
    """Preview (H, W, 3) with the pixels that the ranking's budget refines in red, redder is first."""
    buffers = ranking.buffers
    urgency = ranking.urgency(int(np.count_nonzero(ranking.mask)))
    return tint(buffers.picture(buffers.preview), buffers.picture(urgency))
