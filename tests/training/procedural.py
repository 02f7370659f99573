# SPDX-License-Identifier: GPL-3.0-or-later
"""Procedural octrees from formulas, as small scenes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from patchnet.patchnet_addon.cells.morton import morton_encode
from patchnet.patchnet_addon.cells.scales import LUMINANCE_SCALE, NORMAL_SCALE
from patchnet.patchnet_addon.octree.file import save_octree
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.levels import hierarchy
from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.training.data.dataset import Dataset, save_samples
from patchnet.training.data.samples import Samples, SampleSettings, draw_samples


def octree_from_leaves(cells: np.ndarray, luminance: np.ndarray, normal: np.ndarray, depth: int) -> Octree:
    """Octree whose leaves are `cells` (N, 3) of level `depth`, each of area 1.

    luminance: (N,) in [0, 1]. normal: (N, 3) of length at most 1. Cells that occur twice are averaged.
    """
    keys, place = np.unique(morton_encode(cells), return_inverse=True)
    area: np.ndarray = np.bincount(place).astype(np.float64)  # (n,)
    values = np.column_stack([luminance, normal]).astype(np.float64)  # (N, 4)
    sums = np.stack([np.bincount(place, values[:, k]) for k in range(4)], axis=1)
    child_mask, first_child = hierarchy({depth: keys}, depth)
    levels = [(area, sums)]
    for _ in range(depth):
        keys, place = np.unique(keys >> np.uint64(3), return_inverse=True)
        area = np.bincount(place, area)
        sums = np.stack([np.bincount(place, sums[:, k]) for k in range(4)], axis=1)
        levels.insert(0, (area, sums))
    area = np.concatenate([area for area, _ in levels])
    means = np.concatenate([sums for _, sums in levels]) / area[:, None]
    return Octree(
        grid=Grid((0.0, 0.0, 0.0), 1.0, depth),
        level_start=np.cumsum([0, *(len(area) for area, _ in levels)]).astype(np.int64),
        child_mask=child_mask,
        first_child=first_child,
        area_world=area.astype(np.float32),
        luminance=np.rint(means[:, 0] * LUMINANCE_SCALE).astype(np.uint16),
        normal=np.rint(means[:, 1:] * NORMAL_SCALE).astype(np.int8),
        provenance={"scene": "procedural"},
    )


def spheres_and_slats(depth: int, seed: int = 0, spheres: int = 6, slats: int = 12) -> Octree:
    """Spheres of several sizes behind thin slats, each with its own luminance: curved, thin and empty parts in one.

    Sampled densely enough that no surface has holes.
    """
    random = np.random.default_rng(seed)
    side = 1 << depth
    points, normals, values = [], [], []
    for _ in range(spheres):
        radius = random.uniform(0.05, 0.22)
        centre = random.uniform(radius, 1 - radius, 3)
        unit = random.standard_normal((int(60 * (radius * side) ** 2) + 64, 3))
        unit /= np.linalg.norm(unit, axis=1, keepdims=True)
        points.append(centre + radius * unit)
        normals.append(unit)
        values.append(np.clip(random.uniform(0.2, 0.9) + 0.3 * unit[:, 2], 0, 1))
    for _ in range(slats):
        axis = int(random.integers(3))
        low = random.uniform(0, 0.8, 3)
        size = random.uniform(0.1, 0.4, 3)
        size[axis] = 0.0
        size[(axis + 1) % 3] = random.uniform(0.5, 3) / side
        place = random.uniform(
            0, 1, (int(6 * size[(axis + 2) % 3] * side * max(2, size[(axis + 1) % 3] * side)) + 64, 3)
        )
        points.append(np.clip(low + place * size, 0, 1 - 1e-6))
        normals.append(np.tile(np.eye(3)[axis], (len(place), 1)))
        values.append(np.full(len(place), random.uniform(0.05, 1.0)))
    cells = np.clip((np.concatenate(points) * side).astype(np.int64), 0, side - 1)
    return octree_from_leaves(cells, np.concatenate(values), np.concatenate(normals), depth)


def save_drawn(folder: Path, name: str, octree: Octree, samples: Samples, settings: SampleSettings) -> Path:
    """Write an octree and samples of it into a folder; returns the file of the samples."""
    save_octree(octree, folder / f"{name}.safetensors")
    path = folder / f"{name}.samples.safetensors"
    save_samples(samples, folder / f"{name}.safetensors", octree, settings, path)
    return path


def two_datasets(min_level: int, lookahead: int = 2) -> list[Dataset]:
    """Samples of two small scenes."""
    found = []
    for seed in (1, 2):
        octree = spheres_and_slats(6, seed=seed)
        settings = SampleSettings(views=4, min_level=min_level, held_out=0.05, seed=seed, lookahead=lookahead)
        samples = drain(draw_samples(octree, 400, settings))
        found.append(Dataset(f"scene {seed}", octree, samples, {"settings": {"lookahead": lookahead}}))
    return found
