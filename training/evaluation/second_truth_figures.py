# SPDX-License-Identifier: GPL-3.0-or-later
"""Figure of the cameras of a second truth: one ray a pixel, 32x32 rays, the render, and where the two truths differ."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...patchnet_addon.image.tone import gray
from ..benchmarks.figures import save_figure
from .second_truth import DIFFUSE, CameraResult

_TITLES = ("octree, one ray a pixel", "octree, 32 x 32 rays", "Cycles, diffuse light", "|octree - Cycles|")


def draw_cameras(results: Sequence[CameraResult], folder: Path, name: str) -> Path:
    """Draw a row of pictures for each camera; returns the file; raises PatchNetError if it cannot be written."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(2.6 * len(_TITLES), 2.8 * len(results)), dpi=100, layout="constrained")
    rows = figure.subplots(len(results), len(_TITLES), squeeze=False)
    for axes, result in zip(rows, results, strict=True):
        buffers, cycles = result.buffers, result.truths[DIFFUSE].luminance
        assert buffers.reference is not None
        pictures = [gray(buffers.picture(values)) for values in (buffers.preview, buffers.reference, cycles)]
        for each, picture in zip(axes, pictures, strict=False):
            each.imshow(np.clip(picture[::-1], 0.0, 1.0), interpolation="nearest")
        difference = np.abs(buffers.picture(buffers.reference - cycles))
        axes[-1].imshow(difference[::-1], cmap="magma", vmin=0.0, vmax=0.5, interpolation="nearest")
        axes[-1].set_xlabel(f"bias {1e4 * result.bias[DIFFUSE] / max(result.errors[DIFFUSE].active, 1):.1f}e-4")
        axes[0].set_ylabel(result.camera.name)
        for each, title in zip(axes, _TITLES, strict=True):
            each.set_title(title, fontsize=9)
            each.set(xticks=[], yticks=[])
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.png"
    save_figure(figure, path)
    return path
