# SPDX-License-Identifier: GPL-3.0-or-later
"""Failures of a network: the squares of pictures where what it says of the patch is farthest from the patch itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.codes.predict import Prediction
from ...patchnet_addon.network.weights import Weights
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ...patchnet_addon.sampling.trace import trace_view
from ...patchnet_addon.tracing.camera import Camera
from ..strategies.registry import EVALUATED
from .codes import coded_octree
from .panels import Crop, save_panels, show_picture, show_values
from .tracks import camera_track

FIGURE = "failures"
_SIDE = 24  # pixels of a square that is shown
_NEEDED = "patchnet", "patchnet-exact"


@dataclass(frozen=True, eq=False)
class Failure:
    """Worst square of a scene, in frame `frame` of its track.

    squared: mean squared error there of coverage x luminance; of_all: of all pixels with look-ahead of all frames.
    """

    scene: str
    frame: int
    crop: Crop
    buffers: PixelBuffers
    squared: float
    of_all: float


def worst_failure(coded: CodedOctree, scene: str, cameras: Mapping[int, Camera]) -> Steps[Failure]:
    """Worst square of some frames of a scene: coverage x luminance of the network against the exact patch's."""
    worst: Failure | None = None
    total, count = 0.0, 0
    for number, (frame, camera) in enumerate(cameras.items()):
        yield Progress(number, len(cameras), f"Looking for failures in {scene}")
        wanted = [EVALUATED[name] for name in _NEEDED]
        buffers = yield from trace_view(coded.octree, camera, wanted, coded=coded, reference=False)
        squared = _squared(buffers)
        assert buffers.prediction is not None
        total, count = total + float(squared.sum()), count + int(np.count_nonzero(buffers.prediction.look_ahead))
        means = sliding_window_view(buffers.picture(squared), (_SIDE, _SIDE)).mean(axis=(2, 3))
        row, column = np.unravel_index(int(np.argmax(means)), means.shape)
        here = float(means[row, column])
        if worst is None or here > worst.squared:
            worst = Failure(scene, frame, Crop(int(row), int(column), _SIDE), buffers, here, 0.0)
    if worst is None:
        raise ValueError("no frames to look for failures in")
    return replace(worst, of_all=total / max(count, 1))


def _squared(buffers: PixelBuffers) -> np.ndarray:
    """Squared error (P,) of coverage x luminance where the network has said anything."""
    assert buffers.prediction is not None
    assert buffers.exact is not None
    difference = _product(buffers.prediction) - _product(buffers.exact)
    return np.where(buffers.prediction.look_ahead, difference, 0.0) ** 2


def _product(prediction: Prediction) -> np.ndarray:
    return prediction.coverage.astype(np.float64) * prediction.luminance


def make_failures(octrees: Sequence[Path], network: Weights, every: int, out: Path) -> Steps[list[Path]]:
    """Draw a row of panels for each octree file, worst squares only; returns the figure's files.

    every: of a track's frames. Raises PatchNetError if codes or figure cannot be written.
    """
    found = []
    for path in octrees:
        coded = yield from coded_octree(path, network)
        cameras = dict(enumerate((yield from camera_track(coded.octree))))
        chosen = {frame: cameras[frame] for frame in range(0, len(cameras), every)}
        found.append((yield from worst_failure(coded, path.name.partition(".")[0], chosen)))
    return _draw(found, out)


def _draw(failures: Sequence[Failure], out: Path) -> list[Path]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.6, 1.85 * len(failures) + 0.2), dpi=150, layout="constrained")
    rows = figure.subplots(len(failures), 5, squeeze=False)
    for row, failure in zip(rows, failures, strict=True):
        buffers, at = failure.buffers, failure.crop.slices
        exact, ours = buffers.exact, buffers.prediction
        assert exact is not None
        assert ours is not None
        title = f"{failure.scene}, frame {failure.frame}"
        show_picture(row[0], _gray(buffers.picture(buffers.preview)[at]), title)
        show_picture(row[1], _gray(buffers.picture(_product(exact))[at]), "patch, exact")
        show_picture(
            row[2], _gray(buffers.picture(_product(ours))[at]), f"network, {failure.squared / failure.of_all:.0f}x"
        )
        show_values(row[3], buffers.picture(exact.coverage)[at], 1.0, "coverage, exact")
        show_values(row[4], buffers.picture(ours.coverage)[at], 1.0, "coverage, network")
    return save_panels(figure, out, FIGURE)


def _gray(luminance: np.ndarray) -> np.ndarray:
    from ...patchnet_addon.image.tone import gray

    return gray(luminance.astype(np.float32))
