# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths in dense geometry: every voxel gets its share, and little more."""

import numpy as np
import pytest

import patchnet.patchnet_addon.lightmap.charts as charts_module
from patchnet.patchnet_addon.lightmap.chart_lookup import texel_owners
from patchnet.patchnet_addon.lightmap.charts import Charts, layout_charts
from patchnet.patchnet_addon.octree.voxelize import triangle_areas_and_normals
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.mesh import Material, TriangleBatch, TriangleMesh

TEXEL = 1.0
SAMPLES = 64


def bush(count: int, side: float, size: float, seed: int = 0) -> np.ndarray:
    """Triangles (count, 3, 3) of about `size` in a cube of `side`."""
    rng = np.random.default_rng(seed)
    return rng.uniform(0, side, (count, 1, 3)) + rng.normal(size=(count, 3, 3)) * size


def wall(side: float) -> np.ndarray:
    """Two large triangles (2, 3, 3)."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) * side - [2 * side, 0, 0]
    return corners[[[0, 1, 2], [0, 2, 3]]]


def laid_out(corners: np.ndarray, texel: float | np.ndarray = TEXEL, samples: int = SAMPLES, **settings) -> Charts:
    return drain(layout_charts(TriangleMesh.from_arrays(corners), texel, samples=samples, **settings))


def paths(charts: Charts) -> np.ndarray:
    """Paths (T,) that each triangle gets, counted texel by texel."""
    total = np.zeros(len(charts.page), np.int64)
    for page, samples in enumerate(charts.page_samples):
        owners = texel_owners(charts, page)
        total += np.bincount(owners[owners >= 0], minlength=len(total)) * int(samples)
    return total


def cells(corners: np.ndarray, side: float) -> np.ndarray:
    place = np.floor((corners.mean(axis=1) - corners.reshape(-1, 3).min(axis=0)) / side).astype(int)
    return np.unique(place, axis=0, return_inverse=True)[1].reshape(-1)


def test_cells_get_what_their_area_asks_for(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("PATHS_PER_TRIANGLE", "PATHS_PER_CALL"):  # as if pages cost nothing
        monkeypatch.setattr(charts_module, name, 0)
    corners = bush(60_000, 8.0, 0.1)
    charts = laid_out(corners, page_side=128)
    cell = cells(corners, TEXEL)
    got = np.bincount(cell, paths(charts))
    area = np.bincount(cell, triangle_areas_and_normals(corners)[0])
    asked = SAMPLES * np.maximum(area / TEXEL**2, 1.0)
    assert (got >= 0.99 * asked).all()
    assert got.sum() < 2.1 * asked.sum()
    assert paths(charts).min() >= 1
    assert SAMPLES * len(corners) > 10 * got.sum()  # what it would have been


def test_only_crowds_share() -> None:
    corners = np.concatenate([bush(60_000, 8.0, 0.1), wall(20.0), bush(5, 3.0, 0.3, seed=1) + 100.0])
    charts = laid_out(corners, page_side=128)
    samples = charts.page_samples[charts.page]
    assert (samples[60_000:] == SAMPLES).all()
    assert (samples[:60_000] < SAMPLES / 4).mean() > 0.9
    assert charts.group is not None
    assert not set(charts.group[:60_000]) & set(charts.group[60_000:])


def test_materials_do_not_share() -> None:
    corners = np.repeat(bush(20_000, 4.0, 0.05), 2, axis=0)
    both = np.arange(len(corners), dtype=np.int32) % 2
    batch = TriangleBatch(corners, np.zeros((len(corners), 3, 2), np.float32), both, 0)
    mesh = TriangleMesh((batch,), (Material("One"), Material("Two")))
    charts = drain(layout_charts(mesh, TEXEL, samples=SAMPLES, page_side=64))
    assert charts.group is not None
    assert not set(charts.group[::2]) & set(charts.group[1::2])


def test_texels_follow_the_size_asked_for_each_triangle() -> None:
    corners = np.concatenate([wall(64.0), wall(64.0) + [200.0, 0, 0]])
    charts = laid_out(corners, np.array([1.0, 1.0, 4.0, 4.0], np.float32))
    own = paths(charts) / SAMPLES
    assert own[:2].sum() == 64**2 and own[2:].sum() == 16**2
    assert charts.texel_world == 1.0 and charts.growth == 1.0
    small = laid_out(corners, np.array([1.0, 1.0, 4.0, 4.0], np.float32), max_texels=1100)
    own = paths(small) / SAMPLES
    assert 1.5 < small.growth < 2.1
    assert own[:2].sum() == 32**2 and own[2:].sum() == 8**2
