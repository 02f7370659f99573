# SPDX-License-Identifier: GPL-3.0-or-later
"""Training frames of the error estimator on camera tracks, and the table of their pixels, in augmented batches."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from ...patchnet_addon.codes.encode import encode_octree
from ...patchnet_addon.network.weights import Weights
from ...patchnet_addon.octree.file import load_octree
from ...patchnet_addon.runtime.progress import Progress, Steps, drain
from ...patchnet_addon.sampling.patchnet_plus import NEEDS
from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ...patchnet_addon.sampling.plus.features import windows_of
from ...patchnet_addon.sampling.plus.forms import Plane
from ...patchnet_addon.sampling.plus_planes import view_planes
from ...patchnet_addon.sampling.strategy import Strategy
from ...patchnet_addon.sampling.trace import trace_view
from ...patchnet_addon.tracing.supersample import supersample
from ..evaluation.tracks import TrackSettings, camera_track
from ..network.research_encoder import research_encoder

SYMMETRIES = 8  # symmetries of a square
_RAYS = slice(Plane.RAY_0, Plane.RAY_3 + 1)
_INPUTS = Strategy(
    "inputs", "Inputs", "Inputs of all error estimators", NEEDS, lambda buffers: buffers.preview, "luminance", 1.0
)


def pixels_of(path: Path, weights: Weights, settings: TrackSettings, side: int, pixels: int) -> Steps[PixelTable]:
    """Table of up to `pixels` active pixels of each frame of an octree's track, chosen by its seed.

    side: rays along a pixel's side of the reference. Raises OctreeFileError, and SettingError or SceneError as
    `camera_track`.
    """
    octree = load_octree(path)
    cameras = yield from camera_track(octree, settings)
    cameras = cameras[settings.every // 2 :: settings.every] or cameras[:1]
    coded = yield from encode_octree(octree, weights, encoder=research_encoder(weights))
    parts = []
    for number, camera in enumerate(cameras):
        yield Progress(number, len(cameras), "Gathering pixels")
        view = drain(trace_view(octree, camera, [_INPUTS], coded=coded, reference=False))
        view = replace(view, reference=drain(supersample(octree, camera, side)).luminance)
        parts.append(PixelTable.of(view, pixels, np.random.default_rng([settings.seed, number])))
    return PixelTable.joined(parts)


@dataclass(frozen=True, eq=False)
class PixelTable:
    """Table of N pixels.

    windows: (N, C, 9) float32 of all planes, in the order of `Plane`. errors: squared errors (N,) float32 by the plane
    of the shown picture.
    """

    windows: np.ndarray
    errors: dict[Plane, np.ndarray]

    @classmethod
    def of(cls, view: PixelBuffers, pixels: int, random: np.random.Generator) -> PixelTable:
        """Table of up to `pixels` random active pixels of a view with its reference."""
        assert view.reference is not None and view.predicted is not None
        active = np.flatnonzero(view.active)
        chosen = np.sort(random.choice(active, min(pixels, len(active)), replace=False))
        windows = windows_of(view_planes(view, tuple(Plane)))[:, :, chosen]
        shown = {Plane.LUMINANCE: view.preview, Plane.PREDICTED: view.predicted}
        errors = {name: (picture[chosen] - view.reference[chosen]) ** 2 for name, picture in shown.items()}
        return cls(np.ascontiguousarray(windows.transpose(2, 0, 1)), errors)

    @classmethod
    def joined(cls, parts: list[PixelTable]) -> PixelTable:
        """Join tables."""
        windows = np.concatenate([np.empty((0, len(Plane), 9), np.float32), *(part.windows for part in parts)])
        shown = (Plane.LUMINANCE, Plane.PREDICTED)
        none = np.empty(0, np.float32)
        return cls(windows, {name: np.concatenate([none, *(part.errors[name] for part in parts)]) for name in shown})

    def __len__(self) -> int:
        """Return the number of pixels."""
        return len(self.windows)

    def batch(self, rows: np.ndarray, symmetry: int) -> np.ndarray:
        """Windows (C, 9, B) of rows (B,), under one of the eight symmetries of a square."""
        places, rays = symmetries()[symmetry]
        windows = self.windows[rows][:, :, places]
        windows[:, _RAYS] = windows[:, _RAYS][:, rays]
        return np.ascontiguousarray(windows.transpose(1, 2, 0))


@cache
def symmetries() -> tuple[tuple[np.ndarray, ...], ...]:
    """Permutations of a window's 9 pixels and of a pixel's 4 rays by symmetry; the first is the identity."""
    grids = np.arange(9).reshape(3, 3), np.arange(4).reshape(2, 2)
    return tuple(
        tuple(np.rot90(grid.T if number >= 4 else grid, number % 4).ravel() for grid in grids)
        for number in range(SYMMETRIES)
    )
