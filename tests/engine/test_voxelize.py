# SPDX-License-Identifier: GPL-3.0-or-later
"""The voxelizer against independent references: conserved area, clipping cell by cell, order of triangles.

Over random triangles too: slivers, huge, tiny, on voxel faces, twice, degenerate.
"""

from unittest import mock

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from patchnet.patchnet_addon.octree import blocks
from patchnet.patchnet_addon.octree.blocks import all_cells
from patchnet.patchnet_addon.octree.clip import clip_triangles
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.leaf_levels import LeafLevels
from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.patchnet_addon.octree.voxelize import LeafDetail
from patchnet.patchnet_addon.runtime.errors import GeometryError
from patchnet.patchnet_addon.surface.mesh import RotatedSource, Shading, TriangleMesh, random_rotation
from patchnet.patchnet_addon.surface.shading import bisected_shade, two_lights_shade
from patchnet.patchnet_addon.surface.triangles import triangle_areas_and_normals
from patchnet.tests.references.clip import centroids, clip_reference
from patchnet.tests.references.lookups import node_at
from patchnet.training.benchmarks.shells import shell_triangles

from .mesh_samples import even, in_batches, leaves_of, octree_of


def position_shade(batch, fragments):
    """Luminance that varies over the surface: the x coordinate of the piece's centroid."""
    x = centroids(batch.corners_world, fragments)[:, 0].astype(np.float32)
    return Shading(x, np.ones(len(fragments), np.float32))


def soup(count, seed=0, size=0.1):
    rng = np.random.default_rng(seed)
    return rng.uniform(0.2, 0.8, (count, 1, 3)) + rng.normal(size=(count, 3, 3)) * size


SIDE = 8  # cells along an axis, each of side 1
GRID = Grid((0.0, 0.0, 0.0), float(SIDE), 3)

inside = st.floats(0, SIDE, width=32)
point = st.tuples(inside, inside, inside)
on_faces = st.tuples(*[st.integers(0, SIDE).map(float)] * 3)
small = st.floats(-1, 1, width=32)
offset = st.tuples(small, small, small)


def near(corner, offsets, size):
    moved = [np.clip(np.add(corner, np.multiply(size, by)), 0, SIDE) for by in offsets]
    return np.array([corner, *moved], float)


def flat(points, axis, plane):
    """A triangle in a plane between voxels."""
    corners = np.array(points, float)
    corners[:, axis] = plane
    return corners


two = st.tuples(offset, offset)
any_triangle = st.one_of(
    st.tuples(point, point, point).map(lambda corners: np.array(corners, float)),
    st.tuples(on_faces, on_faces, on_faces).map(lambda corners: np.array(corners, float)),
    st.builds(flat, st.tuples(point, point, point), st.integers(0, 2), st.integers(0, SIDE)),
    st.builds(near, point, two, st.sampled_from([1e-2, 1e-5, 1e-9])),
    st.builds(near, on_faces, two, st.sampled_from([1e-2, 1e-5])),
    st.builds(lambda a, b, by: np.stack([a, *near(b, [by], 1e-6)]), point, point, offset),  # a sliver
    st.builds(lambda a, b: np.array([a, b, a]), point, point),
    st.builds(lambda a, b: np.array([a, b, (np.array(a) + b) / 2]), point, point),
)  # fmt: skip
soups = st.lists(st.tuples(any_triangle, st.integers(1, 3)), min_size=1, max_size=12).map(
    lambda chosen: np.concatenate([np.repeat(corners[None], times, axis=0) for corners, times in chosen])
)
coordinate = st.one_of(st.integers(0, 8).map(float), st.floats(0, 8, width=32))
triangle = st.lists(coordinate, min_size=9, max_size=9).map(lambda values: np.array(values).reshape(3, 3))


@settings(max_examples=150, deadline=None)
@given(triangle)
def test_clip_equals_clipping_each_cell_alone(corners):
    """Cells 28 to 35 of 64 lie in eight bricks of 32."""
    corners, area = corners + 28, triangle_areas_and_normals(corners[None])[0]
    wanted = all_cells(6)
    keys, _, barycentric, areas, *_ = clip_triangles(corners[None], area, 0, 1, (0, 64), 64, wanted.near, wanted.block)
    if area[0] < 1e-9:
        return
    expected = {key: piece for key, piece in clip_reference(corners, 64).items() if piece[0] > 1e-9}
    shares = dict(zip(keys.tolist(), areas / area[0], strict=True))
    assert expected.keys() <= shares.keys()
    assert all(share < 1e-6 for key, share in shares.items() if key not in expected)
    assert sum(shares.values()) == pytest.approx(1, abs=1e-9)
    for key, weights in zip(keys.tolist(), barycentric, strict=True):
        if key in expected and expected[key][0] > 1e-6:
            assert shares[key] == pytest.approx(expected[key][0], abs=1e-9)
            np.testing.assert_allclose(weights, expected[key][1], atol=1e-4)


def test_occupied_cells_are_those_of_the_leaves():
    """Where nothing is added up the cells are the same: of several levels, with gaps, in few and in many passes."""
    mesh = TriangleMesh.from_arrays(soup(300, seed=4))
    grid = Grid.around(mesh.bounds_world, 8)
    levels = np.random.default_rng(5).integers(4, 9, 8**3).astype(np.uint8)
    layout = LeafLevels(levels)

    def with_gaps(batch, fragments):
        return position_shade(batch, fragments)._replace(opacity=(fragments.triangle % 3 > 0).astype(np.float32))

    expected = leaves_of(mesh, grid, with_gaps, layout=layout)
    assert len(expected) == 5
    for count in (1 << 10, 1 << 24):
        found = leaves_of(
            mesh, grid, with_gaps, layout=layout, detail=LeafDetail(only_keys=True), block_fragments=count
        )
        for one, two in zip(expected, found, strict=True):
            assert one.level == two.level and not any(map(len, two.sums))
            np.testing.assert_array_equal(one.keys, two.keys)


def test_opacity_cuts_the_surface():
    corners = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 1], [1, 0, 1], [0, 1, 1]]], float)
    mesh = TriangleMesh.from_arrays(corners)
    octree = octree_of(mesh, even(0.5, [1, 0]), 4)
    assert octree.cells(4)[:, 2].max() == 0
    with pytest.raises(GeometryError, match="transparent"):
        octree_of(mesh, even(0.0, 0.0), 4)


@settings(max_examples=60, deadline=None)
@given(soups)
def test_area_is_conserved_and_touched_voxels_are_there(corners):
    areas, _ = triangle_areas_and_normals(corners)
    assume(areas.sum() > 0)
    (leaves,) = leaves_of(TriangleMesh.from_arrays(corners), GRID, position_shade)
    assert leaves.sums.area.sum(dtype=np.float64) == pytest.approx(areas.sum(), rel=1e-6, abs=1e-9)
    assert (np.diff(leaves.keys.astype(np.int64)) > 0).all() and (leaves.sums.area > 0).all()
    touched = {}
    for part, area in zip(corners, areas, strict=True):
        if area > 0:
            for key, (share, _) in clip_reference(part, SIDE).items():
                touched[key] = touched.get(key, 0.0) + share * area
    found = dict(zip(leaves.keys.tolist(), leaves.sums.area.tolist(), strict=True))
    for key, area in touched.items():
        assert found.get(key, 0.0) == pytest.approx(area, rel=1e-5, abs=1e-7)
    assert all(area < 1e-7 for key, area in found.items() if key not in touched)


@settings(max_examples=50, deadline=None)
@given(soups, st.randoms(use_true_random=False), st.integers(1, 200), st.integers(1, 50))
def test_bits_do_not_depend_on_order_batches_blocks_and_tasks(corners, random, block_fragments, task_fragments):
    assume(triangle_areas_and_normals(corners)[0].sum() > 0)
    (reference,) = leaves_of(TriangleMesh.from_arrays(corners), GRID, position_shade)
    order = random.sample(range(len(corners)), len(corners))
    cuts = sorted(random.sample(range(1, len(corners)), min(2, len(corners) - 1)))
    mesh = TriangleMesh(in_batches(corners[order], cuts))
    with mock.patch.object(blocks, "FRAGMENTS_PER_TASK", task_fragments):
        (other,) = leaves_of(mesh, GRID, position_shade, block_fragments=block_fragments)
    np.testing.assert_array_equal(reference.keys, other.keys)
    for expected, found in zip(reference.sums, other.sums, strict=True):
        np.testing.assert_array_equal(expected, found)


def test_rotation_is_proper_and_keeps_areas():
    rotation = random_rotation(3)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) > 0
    corners = np.random.default_rng(0).normal(size=(20, 3, 3))
    source = TriangleMesh.from_arrays(corners)
    turned = RotatedSource(source, rotation)
    (batch,) = turned.batches()
    areas, normals = triangle_areas_and_normals(corners)
    turned_areas, turned_normals = triangle_areas_and_normals(batch.corners_world)
    np.testing.assert_allclose(turned_areas, areas)
    np.testing.assert_allclose(turned_normals, normals @ rotation.T, atol=1e-12)
    points = batch.corners_world.reshape(-1, 3)
    np.testing.assert_array_equal(turned.bounds_world, [points.min(axis=0), points.max(axis=0)])


DEPTH = 6


def octrees(axis: int, share: float) -> tuple[Octree, Octree]:
    """A sphere of large triangles, cut open and whole."""
    mesh = TriangleMesh.from_arrays(shell_triangles(1.0, rows=6))
    shade = two_lights_shade(mesh)
    bisected = bisected_shade(shade, mesh.bounds_world, axis, share)
    return octree_of(mesh, bisected, DEPTH, exposure=1.0), octree_of(mesh, shade, DEPTH, exposure=1.0)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_leaves_below_the_plane_stay_as_they_are(axis: int) -> None:
    cut, whole = octrees(axis, 0.3)
    cells, whole_cells = cut.cells(DEPTH), whole.cells(DEPTH)
    bounds = TriangleMesh.from_arrays(shell_triangles(1.0, rows=6)).bounds_world[:, axis]
    plane = (bounds[0] + 0.3 * (bounds[1] - bounds[0]) - cut.grid.origin_world[axis]) / cut.grid.voxel_size_world
    assert cells[:, axis].max() <= plane
    expected = whole_cells[whole_cells[:, axis] + 1 <= plane]
    assert len(expected) <= len(cells) < len(expected) + 200
    nodes, whole_nodes = node_at(cut, DEPTH, expected), node_at(whole, DEPTH, expected)
    assert nodes.min() >= 0
    np.testing.assert_array_equal(cut.area_world[nodes], whole.area_world[whole_nodes])
    np.testing.assert_array_equal(cut.luminance[nodes], whole.luminance[whole_nodes])


def test_plane_above_all_leaves_nothing_out() -> None:
    cut, whole = octrees(1, 1.0)
    np.testing.assert_array_equal(cut.child_mask, whole.child_mask)
