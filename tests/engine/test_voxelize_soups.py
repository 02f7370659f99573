# SPDX-License-Identifier: GPL-3.0-or-later
"""Properties of the voxelizer over random triangle soups: slivers, huge, tiny, on voxel faces, twice, degenerate."""

from unittest import mock

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from patchnet.patchnet_addon.octree import blocks
from patchnet.patchnet_addon.octree.accumulate import LeafAccumulator
from patchnet.patchnet_addon.octree.file import octree_arrays
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.leaf_levels import LeafLevels
from patchnet.patchnet_addon.octree.voxelize import triangle_areas_and_normals
from patchnet.patchnet_addon.surface.mesh import Fragments, TriangleBatch, TriangleMesh
from patchnet.tests.references.clip import clip_reference
from patchnet.tests.references.lookups import octree_from_leaves

from .leaf_samples import leaves_of

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
triangle = st.one_of(
    st.tuples(point, point, point).map(lambda corners: np.array(corners, float)),
    st.tuples(on_faces, on_faces, on_faces).map(lambda corners: np.array(corners, float)),
    st.builds(flat, st.tuples(point, point, point), st.integers(0, 2), st.integers(0, SIDE)),
    st.builds(near, point, two, st.sampled_from([1e-2, 1e-5, 1e-9])),
    st.builds(near, on_faces, two, st.sampled_from([1e-2, 1e-5])),
    st.builds(lambda a, b, by: np.stack([a, *near(b, [by], 1e-6)]), point, point, offset),  # a sliver
    st.builds(lambda a, b: np.array([a, b, a]), point, point),
    st.builds(lambda a, b: np.array([a, b, (np.array(a) + b) / 2]), point, point),
)  # fmt: skip
soups = st.lists(st.tuples(triangle, st.integers(1, 3)), min_size=1, max_size=12).map(
    lambda chosen: np.concatenate([np.repeat(corners[None], times, axis=0) for corners, times in chosen])
)


def position_shade(batch, fragments):
    """The x coordinate of the piece's centroid as luminance."""
    b1, b2 = fragments.barycentric.T
    x = batch.corners_world[fragments.triangle, :, 0]
    return ((1 - b1 - b2) * x[:, 0] + b1 * x[:, 1] + b2 * x[:, 2]).astype(np.float32), np.ones(len(b1), np.float32)


def batches(corners, cuts):
    parts = np.split(corners, cuts)
    starts = [0, *cuts]
    return TriangleMesh(
        tuple(
            TriangleBatch(part, np.zeros((len(part), 3, 2), np.float32), np.zeros(len(part), np.int32), start)
            for part, start in zip(parts, starts, strict=True)
        )
    )


@settings(max_examples=150, deadline=None)
@given(soups)
def test_area_is_conserved_and_touched_voxels_are_there(corners):
    areas, _ = triangle_areas_and_normals(corners)
    assume(areas.sum() > 0)
    (leaves,) = leaves_of(TriangleMesh.from_arrays(corners), GRID, position_shade)
    assert leaves.sums[:, 0].sum(dtype=np.float64) == pytest.approx(areas.sum(), rel=1e-6, abs=1e-9)
    assert (np.diff(leaves.keys.astype(np.int64)) > 0).all() and (leaves.sums[:, 0] > 0).all()
    touched = {}
    for part, area in zip(corners, areas, strict=True):
        if area > 0:
            for key, (share, _) in clip_reference(part, SIDE).items():
                touched[key] = touched.get(key, 0.0) + share * area
    found = dict(zip(leaves.keys.tolist(), leaves.sums[:, 0].tolist(), strict=True))
    for key, area in touched.items():
        assert found.get(key, 0.0) == pytest.approx(area, rel=1e-5, abs=1e-7)
    assert all(area < 1e-7 for key, area in found.items() if key not in touched)


@settings(max_examples=100, deadline=None)
@given(soups, st.randoms(use_true_random=False), st.integers(1, 200), st.integers(1, 50))
def test_bits_do_not_depend_on_order_batches_blocks_and_tasks(corners, random, block_fragments, task_fragments):
    assume(triangle_areas_and_normals(corners)[0].sum() > 0)
    (reference,) = leaves_of(TriangleMesh.from_arrays(corners), GRID, position_shade)
    order = random.sample(range(len(corners)), len(corners))
    cuts = sorted(random.sample(range(1, len(corners)), min(2, len(corners) - 1)))
    with mock.patch.object(blocks, "FRAGMENTS_PER_TASK", task_fragments):
        (other,) = leaves_of(batches(corners[order], cuts), GRID, position_shade, block_fragments=block_fragments)
    np.testing.assert_array_equal(reference.keys, other.keys)
    np.testing.assert_array_equal(reference.sums, other.sums)
    first, second = (octree_arrays(octree_from_leaves([leaves], GRID)) for leaves in (reference, other))
    for name, values in first.items():
        np.testing.assert_array_equal(values, second[name], err_msg=name)


def test_blocks_together_make_the_whole():
    rng = np.random.default_rng(4)
    mesh = TriangleMesh.from_arrays(rng.uniform(0, 1, (300, 1, 3)) + rng.normal(size=(300, 3, 3)) * 0.1)
    grid = Grid.around(mesh.bounds_world, 7)
    assert len(blocks.plan_passes(mesh, grid, LeafLevels.uniform(7), 5000)) > 10
    (whole,) = leaves_of(mesh, grid, position_shade)
    (parts,) = leaves_of(mesh, grid, position_shade, block_fragments=5000)
    np.testing.assert_array_equal(whole.keys, parts.keys)
    np.testing.assert_array_equal(whole.sums, parts.sums)


def test_planned_load_is_near_the_number_of_fragments():
    """The estimate by Steiner's formula is that of a grid at a random position, so the mean over a soup is near."""
    rng = np.random.default_rng(5)
    corners = rng.uniform(0, 1, (400, 1, 3)) + rng.normal(size=(400, 3, 3)) * 0.05
    mesh = TriangleMesh.from_arrays(corners)
    grid = Grid.around(mesh.bounds_world, 7)
    count = 0

    def counting(_batch, fragments):
        nonlocal count
        count += len(fragments)
        return np.zeros(len(fragments), np.float32), np.ones(len(fragments), np.float32)

    leaves_of(mesh, grid, counting)
    sets = blocks.plan_passes(mesh, grid, LeafLevels.uniform(7), count // 10)
    assert 9 <= len(sets) <= 12


def test_many_bricks_and_extreme_luminance():
    """Thousands of new bricks at once, and luminance that is not finite, leave keys in order and means finite."""
    grid = Grid((0.0, 0.0, 0.0), 1.0, 10)
    rng = np.random.default_rng(6)
    keys = rng.integers(0, 1 << 30, 50_000).astype(np.uint64)
    areas = rng.uniform(0, 1e-6, 50_000)
    fragments = Fragments(keys, np.zeros(50_000, np.int32), np.zeros((50_000, 2), np.float32), areas)
    luminance = rng.uniform(0, 1e9, 50_000).astype(np.float32)
    luminance[:3] = np.nan, np.inf, -np.inf
    leaves = LeafAccumulator(grid.voxel_size_world)
    leaves.add(fragments, luminance, np.ones(50_000), np.array([[0.0, 0.0, 1.0]]))
    found, sums, _ = leaves.take()
    expected, place = np.unique(keys, return_inverse=True)
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_allclose(sums[:, 0], np.bincount(place, fragments.area_world), rtol=1e-6)
    assert np.isfinite(sums).all()
    clipped = np.clip(np.nan_to_num(luminance.astype(float), posinf=2.0**32, neginf=-(2.0**32)), -(2.0**32), 2.0**32)
    np.testing.assert_allclose(sums[:, 1], np.bincount(place, clipped * fragments.area_world), rtol=1e-5)
