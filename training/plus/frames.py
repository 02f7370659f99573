# SPDX-License-Identifier: GPL-3.0-or-later
"""Training frames of the error estimator on camera tracks, and the table of their pixels, in augmented batches.

References are rendered once and stored.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from ...patchnet_addon.codes.encode import encode_octree
from ...patchnet_addon.network.weights import Weights
from ...patchnet_addon.octree.file import load_octree, octree_hash
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.errors import FileFormatError
from ...patchnet_addon.runtime.files import read_arrays, write_arrays
from ...patchnet_addon.runtime.progress import Progress, Steps, drain
from ...patchnet_addon.runtime.source_hash import source_hash
from ...patchnet_addon.sampling.patchnet_plus import NEEDS
from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ...patchnet_addon.sampling.plus.features import windows_of
from ...patchnet_addon.sampling.plus.forms import Plane
from ...patchnet_addon.sampling.plus_planes import view_planes
from ...patchnet_addon.sampling.strategy import Strategy
from ...patchnet_addon.sampling.trace import trace_view
from ...patchnet_addon.tracing.camera import Camera
from ...patchnet_addon.tracing.supersample import supersample
from ..evaluation.map_frames import FrameSettings
from ..evaluation.tracks import camera_track
from ..network.research_encoder import research_encoder

KIND = "track-references"
_CODE = ("patchnet_addon.tracing.supersample", "training.evaluation.tracks")
SYMMETRIES = 8  # symmetries of a square
_RAYS = slice(Plane.RAY_0, Plane.RAY_3 + 1)
_INPUTS = Strategy(
    "inputs", "Inputs", "Inputs of all error estimators", NEEDS, lambda buffers: buffers.preview, "luminance", 1.0
)


@dataclass(frozen=True)
class TrackSettings(FrameSettings):
    """Settings of each octree's frames; side: rays along a pixel's side of the reference."""

    every: int = 40
    side: int = 16


def views_of(path: Path, weights: Weights, settings: TrackSettings, folder: Path) -> Steps[Iterator[PixelBuffers]]:
    """Views of an octree's track with all inputs of estimators, and their references.

    References in `folder` are not rendered again. Views are traced on demand. Raises OctreeFileError, and SettingError
    or SceneError as `camera_track`.
    """
    octree = load_octree(path)
    cameras = yield from camera_track(octree, frames=settings.frames, size_px=settings.size_px, seed=settings.seed)
    cameras = cameras[settings.every // 2 :: settings.every] or cameras[:1]
    references = yield from _references(octree, cameras, settings, folder)
    coded = yield from encode_octree(octree, weights, encoder=research_encoder(weights))

    def views() -> Iterator[PixelBuffers]:
        for camera, reference in zip(cameras, references, strict=True):
            steps = trace_view(octree, camera, [_INPUTS], coded=coded, reference=False)
            yield replace(drain(steps), reference=reference)

    return views()


def _references(octree: Octree, cameras: Sequence[Camera], settings: TrackSettings, folder: Path) -> Steps[np.ndarray]:
    """References (F, P) float32 of the cameras, from `folder` if they exist."""
    parts = octree_hash(octree), settings, source_hash(*_CODE)
    key = hashlib.sha256(repr(parts).encode()).hexdigest()[:32]
    path = folder / f"{key[:16]}.safetensors"
    try:
        arrays, metadata = read_arrays(path, KIND)
    except FileFormatError:
        arrays, metadata = {}, {}
    if metadata.get("key") == key:
        return arrays["references"]
    found = []
    for number, camera in enumerate(cameras):
        yield Progress(number, len(cameras), "Rendering references")
        found.append(drain(supersample(octree, camera, settings.side)).luminance)
    references = np.array(found, np.float32)
    folder.mkdir(parents=True, exist_ok=True)
    write_arrays(path, {"references": references}, {"key": key}, KIND)
    return references


@dataclass(frozen=True, eq=False)
class PixelTable:
    """Table of N pixels.

    windows: (N, C, 9) float32 of all planes, in the order of `Plane`. errors: squared errors (N,) float32 by the plane
    of the shown picture.
    """

    windows: np.ndarray
    errors: dict[Plane, np.ndarray]

    @classmethod
    def of(cls, views: Iterable[PixelBuffers], pixels: int, seed: int) -> PixelTable:
        """Table of up to `pixels` active pixels of each view with its reference; chosen by the seed."""
        parts = [_pixels_of(view, pixels, np.random.default_rng([seed, number])) for number, view in enumerate(views)]
        return cls.joined(parts)

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
def symmetries() -> tuple[tuple[np.ndarray, np.ndarray], ...]:
    """Permutations of a window's 9 pixels and of a pixel's 4 rays by symmetry; the first is the identity."""
    grids = np.arange(9).reshape(3, 3), np.arange(4).reshape(2, 2)
    return tuple(
        tuple(np.rot90(grid.T if number >= 4 else grid, number % 4).ravel() for grid in grids)  # type: ignore[misc]
        for number in range(SYMMETRIES)
    )


def _pixels_of(view: PixelBuffers, pixels: int, random: np.random.Generator) -> PixelTable:
    assert view.reference is not None and view.predicted is not None
    active = np.flatnonzero(view.active)
    chosen = np.sort(random.choice(active, min(pixels, len(active)), replace=False))
    windows = windows_of(view_planes(view, tuple(Plane)))[:, :, chosen]
    shown = {Plane.LUMINANCE: view.preview, Plane.PREDICTED: view.predicted}
    errors = {name: (picture[chosen] - view.reference[chosen]) ** 2 for name, picture in shown.items()}
    return PixelTable(np.ascontiguousarray(windows.transpose(2, 0, 1)), errors)
