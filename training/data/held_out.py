# SPDX-License-Identifier: GPL-3.0-or-later
"""Held-out scenes: data sets whose error may be reported as that of unseen scenes (methods 7.21).

A scene counts as seen in any pose and light and with any share in training: its rotated octree shows the same shapes.
Scenes are compared by the provenance of their octrees; in doubt they count as the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from .dataset import Dataset


def scene_of(dataset: Dataset) -> str:
    """File of a data set's scene, else the name of the scene; empty if its octree has neither."""
    made = dataset.octree.provenance
    return Path(str(made.get("file") or made.get("scene") or "")).name


def why_not_held_out(dataset: Dataset, training: Sequence[Dataset]) -> str:
    """Reason why the scene of `dataset` is not held out of `training`; empty if it is.

    File names are compared without case and ending, so that a scene in another file format counts as the same.
    """
    scene = scene_of(dataset)
    if not scene:
        return f"not held out: the octree of {dataset.name} does not say its scene, which may be in training"
    if any(_key(scene_of(other)) == _key(scene) for other in training):
        return f"not held out: {scene} is in training"
    unknown = [other.name for other in training if not scene_of(other)]
    if unknown:
        return f"not held out: the octree of {unknown[0]} in training does not say its scene, which may be {scene}"
    return ""


def _key(scene: str) -> str:
    return Path(scene).stem.casefold()
