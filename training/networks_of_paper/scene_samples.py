# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples of scenes for a run, drawn where they are missing or of other settings, and kept."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from ...patchnet_addon.octree.file import load_octree, octree_hash
from ...patchnet_addon.runtime.errors import FileFormatError
from ...patchnet_addon.runtime.progress import Steps
from ..data.dataset import Dataset, load_dataset, save_samples
from ..data.samples import SampleSettings, draw_samples


def scene_samples(octree: Path, path: Path, count: int, settings: SampleSettings) -> Steps[Dataset]:
    """Samples of an octree file from `path`, or drawn and written there; at least `count` of them.

    Raises PatchNetError for an octree that cannot be read or has no voxels with look-ahead, and OutputError if the
    samples cannot be written.
    """
    if (kept := _kept(octree, path, count, settings)) is not None:
        return kept
    tree = load_octree(octree)
    name = f"Drawing {path.name.partition('.')[0]}, {settings.lookahead} ahead"
    samples = yield from draw_samples(tree, count, settings, name)
    path.parent.mkdir(parents=True, exist_ok=True)
    save_samples(samples, octree, tree, settings, path)
    return load_dataset(path)


def _kept(octree: Path, path: Path, count: int, settings: SampleSettings) -> Dataset | None:
    """Samples that are there, if they are of this octree and these settings."""
    if not path.exists():
        return None
    try:
        dataset = load_dataset(path)
    except FileFormatError:
        return None
    drawn = len(dataset.samples.voxel) * settings.views
    same = dataset.metadata.get("settings") == asdict(settings) and count <= drawn < count + settings.views
    same = same and dataset.metadata["octree_hash"] == octree_hash(load_octree(octree))
    return dataset if same else None
