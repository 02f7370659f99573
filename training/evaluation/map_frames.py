# SPDX-License-Identifier: GPL-3.0-or-later
"""Training frames of map networks, rendered once and stored in a folder (methods 3.9-3.11)."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

from ...patchnet_addon.octree.file import load_octree, octree_hash
from ...patchnet_addon.runtime.files import read_arrays, write_arrays
from ...patchnet_addon.runtime.progress import Progress, Steps, drain
from ...patchnet_addon.runtime.source_hash import source_hash
from . import kept_arrays
from .networks.frames import KIND, RenderedFrame, render_frame
from .tracks import TrackSettings, camera_track

_CODE = "training.evaluation.map_frames"  # renders the frames


def rendered_frames(
    octrees: Sequence[Path], settings: TrackSettings, folder: Path
) -> Steps[tuple[list[RenderedFrame], str]]:
    """Frames of all octrees' tracks, existing ones from `folder`, and a hash of their dependencies."""
    folder.mkdir(parents=True, exist_ok=True)
    frames: list[RenderedFrame] = []
    keys = ""
    for path in octrees:
        octree = load_octree(path)
        parts = octree_hash(octree), settings, source_hash(_CODE)
        key = hashlib.sha256(repr(parts).encode()).hexdigest()[:32]
        keys += key
        track = yield from camera_track(octree, settings)
        cameras = track[:: settings.every]
        for number, camera in enumerate(cameras):
            yield Progress(number, len(cameras), "Rendering training frames")
            file = folder / f"{key[:16]}-{number:05}.safetensors"
            if (kept := kept_arrays(file, KIND, key)) is None:
                write_arrays(file, vars(drain(render_frame(octree, camera))), {"key": key}, KIND)
                kept = read_arrays(file, KIND)[0]  # mapped into memory, as existing ones
            frames.append(RenderedFrame(**kept))
    return frames, hashlib.sha256(keys.encode()).hexdigest()[:32]
