# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths of a bake, counted by voxel."""

import numpy as np

from patchnet.patchnet_addon.lightmap.charts import layout_charts
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.mesh import TriangleMesh
from patchnet.training.benchmarks.path_counts import own_texels, path_counts


def test_every_path_is_counted_once() -> None:
    rng = np.random.default_rng(0)
    corners = rng.uniform(0, 1, (300, 1, 3)) + rng.normal(size=(300, 3, 3)) * 0.05
    mesh = TriangleMesh.from_arrays(corners)
    charts = drain(layout_charts(mesh, 0.02, samples=8))
    counts = drain(path_counts(mesh, charts, Grid.around(mesh.bounds_world, 6)))
    total = (own_texels(charts) * charts.page_samples[charts.page]).sum()
    np.testing.assert_allclose([counts.leaf.sum(), counts.stop.sum()], total, rtol=1e-4)
    assert 1 < len(counts.stop) < len(counts.leaf)


def test_a_wall_gets_the_same_everywhere() -> None:
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float64)
    mesh = TriangleMesh.from_arrays(square[[[0, 1, 2], [0, 2, 3]]])
    grid = Grid((0.0, 0.0, -0.5), 1.0, 7)
    charts = drain(layout_charts(mesh, 2 * grid.voxel_size_world, samples=16))
    counts = drain(path_counts(mesh, charts, grid))
    # A texel of 16 paths on 2 x 2 leaves; the leaves on the diagonal are cut, but by area they lose nothing. The two
    # triangles of a rectangle differ by the texels of its diagonal.
    assert len(counts.leaf) == 128**2 and len(counts.stop) == 32**2
    np.testing.assert_allclose(counts.leaf, 4.0, rtol=0.02)
    np.testing.assert_allclose(counts.stop, 64.0, rtol=0.02)
