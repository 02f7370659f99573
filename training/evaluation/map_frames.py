# SPDX-License-Identifier: GPL-3.0-or-later
"""Training frames of map networks, rendered once and stored in a folder (methods 3.9-3.11)."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ...patchnet_addon.octree.file import load_octree, octree_hash
from ...patchnet_addon.runtime.errors import FileFormatError
from ...patchnet_addon.runtime.progress import Progress, Steps, drain
from ...patchnet_addon.runtime.source_hash import source_hash
from .networks.frames import RenderedFrame, render_frame
from .tracks import camera_track

_CODE = "training.evaluation.map_frames"  # renders the frames


@dataclass(frozen=True)
class FrameSettings:
    """Settings of the frames of each octree, as those of an evaluation: whole track, distance of its frames, pixels."""

    frames: int = 2000
    every: int = 10
    size_px: tuple[int, int] = (130, 130)
    seed: int = 0


def rendered_frames(
    octrees: Sequence[Path], settings: FrameSettings, folder: Path
) -> Steps[tuple[list[RenderedFrame], str]]:
    """Frames of all octrees' tracks, and a hash of their dependencies; existing ones in `folder` are not rendered
    again.

    Raises OctreeFileError, and SettingError or SceneError as `camera_track`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    frames: list[RenderedFrame] = []
    keys = []
    for path in octrees:
        key = _key(octree_hash(load_octree(path)), settings)
        frames += yield from _frames_of(path, settings, folder, key)
        keys.append(key)
    return frames, hashlib.sha256("".join(keys).encode()).hexdigest()[:32]


def _frames_of(path: Path, settings: FrameSettings, folder: Path, key: str) -> Steps[list[RenderedFrame]]:
    octree = load_octree(path)
    cameras = yield from camera_track(octree, frames=settings.frames, size_px=settings.size_px, seed=settings.seed)
    cameras = cameras[:: settings.every]
    frames = []
    for number, camera in enumerate(cameras):
        yield Progress(number, len(cameras), "Rendering training frames")
        file = folder / f"{key[:16]}-{number:05}.safetensors"
        frame = RenderedFrame.load(file, key)
        if frame is None:
            drain(render_frame(octree, camera)).save(file, key)
            frame = RenderedFrame.load(file, key)  # mapped into memory, as existing ones
        if frame is None:
            raise FileFormatError(f"{file} is damaged right after writing: choose another folder for the frames")
        frames.append(frame)
    return frames


def _key(octree: str, settings: FrameSettings) -> str:
    """Hash (32 hex digits) of what the frames depend on: octree, settings and the code that renders."""
    return hashlib.sha256(repr((octree, settings, source_hash(_CODE))).encode()).hexdigest()[:32]
