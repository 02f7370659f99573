# SPDX-License-Identifier: GPL-3.0-or-later
"""Octrees with leaves on several levels: the same leaves as on each level alone, the same means above them."""

import numpy as np
import pytest

from patchnet.patchnet_addon.cells.morton import morton_decode
from patchnet.patchnet_addon.octree import blocks
from patchnet.patchnet_addon.octree import voxelize as voxelizer
from patchnet.patchnet_addon.octree.file import load_octree, save_octree
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.leaf_levels import LeafLevels
from patchnet.patchnet_addon.runtime.errors import GeometryError
from patchnet.patchnet_addon.surface.mesh import TriangleMesh

from .mesh_samples import even, leaves_of, octree_of
from .octree_samples import octree_from_leaves

BLOCK_LEVEL = 2


shade = even(np.arange(154) * 0.37 % 1.0)


@pytest.fixture(scope="module")
def mesh():
    rng = np.random.default_rng(1)
    small = rng.uniform(-1, 1, (150, 1, 3)) + rng.normal(size=(150, 3, 3)) * 0.05
    return TriangleMesh.from_arrays(np.concatenate([small, rng.uniform(-1, 1, (4, 3, 3))]))


@pytest.fixture(scope="module")
def layout():
    levels = np.random.default_rng(2).integers(BLOCK_LEVEL, 9, 8**BLOCK_LEVEL).astype(np.uint8)
    levels[[5, 40]] = 0, 8
    return LeafLevels(levels)


def test_leaves_of_each_level_are_those_of_that_level_alone(mesh, layout):
    grid = Grid.around(mesh.bounds_world, 8)
    parts = leaves_of(mesh, grid, shade, layout=layout)
    assert [part.level for part in parts] == sorted(part.level for part in parts) and len(parts) > 5
    for part in parts:
        (alone,) = leaves_of(mesh, Grid.around(mesh.bounds_world, part.level), shade)
        block = (alone.keys >> np.uint64(3 * (part.level - BLOCK_LEVEL))).astype(int)
        inside = layout.levels[block] == part.level
        np.testing.assert_array_equal(part.keys, alone.keys[inside])
        for found, expected in zip(part.sums, alone.sums, strict=True):
            np.testing.assert_array_equal(found, expected[inside])


@pytest.mark.parametrize(("depth", "mixed"), [(6, False), (8, True)], ids=["uniform", "mixed"])
def test_octree_equals_one_that_is_built_node_by_node(mesh, layout, depth, mixed):
    grid, layout = Grid.around(mesh.bounds_world, depth), layout if mixed else None
    leaves = {}
    for part in leaves_of(mesh, grid, shade, layout=layout):
        for cell, (area, *moments) in zip(
            morton_decode(part.keys).tolist(), np.column_stack(part.sums).tolist(), strict=True
        ):
            luminance, *normal = (value / area for value in moments)
            leaves[part.level, tuple(cell)] = (area, min(1.5 * luminance, 1.0), tuple(normal))
    octree = octree_of(mesh, shade, grid, layout=layout, exposure=1.5)
    expected = octree_from_leaves(leaves, depth)
    for name in ("level_start", "child_mask"):
        np.testing.assert_array_equal(getattr(octree, name), getattr(expected, name), err_msg=name)
    inner = octree.child_mask > 0
    np.testing.assert_array_equal(octree.first_child[inner], expected.first_child[inner])
    np.testing.assert_allclose(octree.area_world, expected.area_world, rtol=1e-5)
    np.testing.assert_allclose(octree.luminance / 65535, expected.luminance / 65535, atol=2e-5)
    np.testing.assert_allclose(octree.normal, expected.normal, atol=1)


def test_levels_below_the_deepest_leaf_are_left_out_and_the_file_is_consistent(mesh, layout, tmp_path):
    shallow = LeafLevels(np.minimum(layout.levels, np.uint8(6)))
    octree = octree_of(mesh, shade, 12, layout=shallow)
    assert octree.depth == 6 and octree.grid.side_world == Grid.around(mesh.bounds_world, 6).side_world
    save_octree(octree, tmp_path / "o.safetensors")
    assert load_octree(tmp_path / "o.safetensors").depth == 6


def test_nothing_is_left_where_no_leaves_are_wanted(mesh):
    with pytest.raises(GeometryError, match="No opaque surface"):
        octree_of(mesh, shade, 4, layout=LeafLevels(np.zeros(8, np.uint8)))


@pytest.mark.parametrize(("cores", "block_fragments"), [(1, 1 << 20), (1, 3000), (2, 1 << 20), (5, 1 << 20)])
def test_bits_do_not_depend_on_the_number_of_cores_and_passes(mesh, layout, cores, block_fragments, monkeypatch):
    grid = Grid.around(mesh.bounds_world, 8)
    expected = leaves_of(mesh, grid, shade, layout=layout)
    monkeypatch.setattr(voxelizer, "usable_cores", lambda: cores)
    monkeypatch.setattr(blocks, "MIN_SHARE", 10)
    passes, _ = blocks.plan_passes(mesh, grid, layout, block_fragments, cores)
    assert {len(shares) for shares in passes} == {cores} and (len(passes) > 5) == (block_fragments == 3000)
    found = leaves_of(mesh, grid, shade, layout=layout, block_fragments=block_fragments)
    for one, other in zip(expected, found, strict=True):
        np.testing.assert_array_equal(one.keys, other.keys)
        for found, expected in zip(one.sums, other.sums, strict=True):
            np.testing.assert_array_equal(found, expected)


def test_a_huge_triangle_of_which_little_is_wanted_is_little_work():
    corners = np.array([[[0.1, 0.2, 0.3], [131071.0, 0.5, 90000.0], [5.0, 131070.0, 40000.0]]])  # cells of level 17
    wanted = np.zeros(8**4, np.bool_)
    assert len(list(blocks.tasks_of(corners, 1 << 17, blocks.CellSet.of_blocks(wanted, 17)))) == 1
    some = wanted.copy()
    some[0] = True
    few = len(list(blocks.tasks_of(corners, 1 << 17, blocks.CellSet.of_blocks(some, 17))))
    every = len(list(blocks.tasks_of(corners, 1 << 17, blocks.CellSet.of_blocks(~wanted, 17))))
    assert 10 < few < every / 50
