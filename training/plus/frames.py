# SPDX-License-Identifier: GPL-3.0-or-later
"""Training frames of the error estimator on camera tracks; references are rendered once and stored."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
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
from ...patchnet_addon.sampling.strategy import Strategy
from ...patchnet_addon.sampling.trace import trace_view
from ...patchnet_addon.tracing.camera import Camera
from ...patchnet_addon.tracing.supersample import supersample
from ..evaluation.map_frames import FrameSettings
from ..evaluation.tracks import camera_track
from ..network.research_encoder import research_encoder

KIND = "track-references"
_CODE = ("patchnet_addon.tracing.supersample", "training.evaluation.tracks")
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
        found.append(drain(supersample(octree, camera, settings.side)))
    references = np.array(found, np.float32)
    folder.mkdir(parents=True, exist_ok=True)
    write_arrays(path, {"references": references}, {"key": key}, KIND)
    return references
