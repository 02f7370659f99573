# SPDX-License-Identifier: GPL-3.0-or-later
"""Exposure, the factor that scales the scene's white to 1, and emitters, which it ignores (methods 7.1).

A visible lamp is a hundred times as bright as its room; if its voxels exceed the small share that may be white, the
room would be dark.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..surface.chroma import REC709
from ..surface.mesh import Fragments, MeshSource, TriangleBatch
from .octree import Octree, keys_below

QUANTILE = 0.995
_OWN_SHARE = 0.5  # least emitted share of an emitter's light


def quantile_exposure(leaf_luminance: np.ndarray) -> float:
    """Factor that scales the 99.5 % quantile of leaf luminance (n,) to 1; 1 for a black scene."""
    white = float(np.quantile(leaf_luminance, QUANTILE))
    return 1.0 / white if white > 0 else 1.0


def exposure_text(octree: Octree) -> str:
    """Exposure of an octree in words: the factor, and whether it is automatic."""
    how = {"automatic": " (automatic)", "given": " (given)"}.get(str(octree.provenance.get("exposure")), "")
    return f"Exposure {octree.exposure:.4g}{how}"


class Emitters:
    """Cells that contain emitting materials; filled during voxelization, from any thread."""

    def __init__(self, source: MeshSource) -> None:
        """Find the emitting materials of `source`."""
        self._emission = np.array([material.emission for material in source.materials], np.float64).reshape(-1, 3)
        self._emission = self._emission @ REC709.astype(np.float64)  # (M,)
        self._cells: list[tuple[int, int, np.ndarray]] = []  # material, level, keys
        self._light: list[tuple[int, float, float]] = []  # material, area * luminance, area

    @property
    def anything(self) -> bool:
        """Return whether any material emits."""
        return bool((self._emission > 0.0).any())

    def note(self, batch: TriangleBatch, fragments: Fragments, luminance: np.ndarray) -> None:
        """Record fragments with their shaded luminance (F,)."""
        materials = batch.materials[fragments.triangle]
        for material in np.unique(materials[self._emission[materials] > 0.0]).tolist():
            mine = materials == material
            area = fragments.area_world[mine]
            self._cells.append((material, fragments.level, np.unique(fragments.keys[mine])))
            self._light.append((material, float(area @ luminance[mine].astype(np.float64)), float(area.sum())))

    def cells(self) -> dict[int, np.ndarray]:
        """Keys (k,) uint64, ascending, of cells with emitters, by level.

        A material is an emitter if it emits at least half of its light, on the mean over its surface.
        """
        shining = {material for material in {each for each, _, _ in self._light} if self._shines(material)}
        levels = {level for material, level, _ in self._cells if material in shining}
        return {
            wanted: np.unique(np.concatenate([k for m, level, k in self._cells if level == wanted and m in shining]))
            for wanted in levels
        }

    def _shines(self, material: int) -> bool:
        light = math.fsum(part for each, part, _ in self._light if each == material)
        area = math.fsum(part for each, _, part in self._light if each == material)
        return bool(self._emission[material] * area >= _OWN_SHARE * light)


def exposure_without_emitters(masks: Sequence[np.ndarray], light: Sequence[np.ndarray], emitters: Emitters) -> float:
    """Automatic exposure of leaves without emitters; of all leaves if no others are lit.

    masks: (n,) uint8 child masks of a level's nodes; light: (l,) float32 luminance of its leaves; both by level.
    """
    cells = emitters.cells()
    if cells:
        rest = np.concatenate(_others(masks, light, cells))
        if (rest > 0.0).any():
            return quantile_exposure(rest)
    return quantile_exposure(np.concatenate(light))


def _others(masks: Sequence[np.ndarray], light: Sequence[np.ndarray], cells: dict[int, np.ndarray]) -> list[np.ndarray]:
    """Luminance of the leaves without emitters, by level."""
    others, keys = [], np.zeros(1, np.uint64)
    for level, mask in enumerate(masks):
        values = light[level]
        if level in cells:
            values = values[~np.isin(keys[mask == 0], cells[level], assume_unique=True)]
        others.append(values)
        keys = keys_below(keys, mask)
    return others
