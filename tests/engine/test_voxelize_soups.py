# SPDX-License-Identifier: GPL-3.0-or-later
"""Properties of the voxelizer over random triangle soups: slivers, huge, tiny, on voxel faces, twice, degenerate."""

from unittest import mock

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from patchnet.patchnet_addon.octree import blocks
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.leaf_levels import LeafLevels
from patchnet.patchnet_addon.octree.voxelize import triangle_areas_and_normals
from patchnet.patchnet_addon.surface.mesh import TriangleBatch, TriangleMesh
from patchnet.tests.references.clip import clip_reference

from .leaf_samples import leaves_of
from .test_voxelize import position_shade

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


@settings(max_examples=50, deadline=None)
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
