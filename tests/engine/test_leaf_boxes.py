# SPDX-License-Identifier: GPL-3.0-or-later
"""Boxes of leaves: those of the clipper, rays that meet them, coverage of thin bars."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings

from patchnet.patchnet_addon.cells.leaf_boxes import STEPS, unpacked
from patchnet.patchnet_addon.cells.morton import morton_decode
from patchnet.patchnet_addon.octree.blocks import all_cells
from patchnet.patchnet_addon.octree.clip import clip_triangles
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.voxelize import LeafDetail
from patchnet.patchnet_addon.surface.mesh import TriangleMesh
from patchnet.patchnet_addon.surface.triangles import triangle_areas_and_normals
from patchnet.patchnet_addon.tracing.camera import ORTHOGRAPHIC, Camera
from patchnet.patchnet_addon.tracing.render import first_hits
from patchnet.patchnet_addon.tracing.supersample import supersample_pixels
from patchnet.tests.references.clip import piece_reference
from patchnet.tests.references.lookups import box_bounds
from patchnet.tests.references.small import boxes_reference

from .mesh_samples import box, octree_of
from .octree_samples import random_octree, with_boxes
from .test_tiles import assert_patch_rays, cameras
from .test_voxelize import position_shade, soup, triangle


@settings(max_examples=100, deadline=None)
@given(triangle)
@example(np.array([[7.605288505554199, 3, 0], [0, 3, 0], [0, 1, 6]]))  # along the edge between four cells
@example(np.array([[3.60528826713562, 3, 0], [0, 3, 0], [0, 1, 6]]))
def test_boxes_of_the_clip_are_around_each_piece(corners):
    """Cells 28 to 35 of 64 lie in eight bricks of 32. A cut on a sixteenth may fall on either side of it."""
    corners, area = corners + 28, triangle_areas_and_normals(corners[None])[0]
    wanted = all_cells(6)
    keys, _, _, areas, *_, boxes = clip_triangles(corners[None], area, 0, 1, (0, 64), 64, wanted.near, wanted.block)
    assert area[0] < 1e-9 or len(keys)
    for cell, piece_area, found in zip(morton_decode(keys), areas, unpacked(boxes).astype(int), strict=True):
        assert (found & 15 <= found >> 4).all()
        points = np.array([point for point, _ in piece_reference(corners, tuple(cell))])
        if len(points) == 0 or piece_area < 1e-12:  # touched in a point or a line: rounding decides how much is where
            continue
        expected = boxes_reference(points - cell).astype(int)
        for ends, wanted_ends in ((found & 15, expected & 15), (found >> 4, expected >> 4)):
            assert (np.abs(ends - wanted_ends) <= 1).all()
        low, high = box_bounds(found)
        assert (low <= points.min(axis=0) - cell + 1e-6).all() and (high >= points.max(axis=0) - cell - 1e-6).all()


def test_boxes_of_leaves_are_around_all_their_pieces():
    corners = soup(40, seed=3)
    mesh = TriangleMesh.from_arrays(corners)
    grid = Grid.around(mesh.bounds_world, 5)
    octree = octree_of(mesh, position_shade, grid, detail=LeafDetail(boxes=True), block_fragments=500)
    voxels = grid.to_unit(corners) * 32
    leaves = octree.cells(5)
    low, high = np.full((len(leaves), 3), np.inf), np.full((len(leaves), 3), -np.inf)
    for one in voxels:
        near = ((leaves + 1 >= one.min(axis=0)) & (leaves <= one.max(axis=0))).all(axis=1)
        for leaf in np.flatnonzero(near):
            if piece := piece_reference(one, tuple(leaves[leaf])):
                points = np.array([point for point, _ in piece]) - leaves[leaf]
                np.minimum(low[leaf], points.min(axis=0), out=low[leaf])
                np.maximum(high[leaf], points.max(axis=0), out=high[leaf])
    expected = np.array([boxes_reference(np.array(pair)) for pair in zip(low, high, strict=True)])
    assert octree.leaf_box.shape == expected.shape
    assert (octree.leaf_box == expected).mean() > 0.999
    plain = octree_of(mesh, position_shade, grid)
    assert plain.leaf_box is None and octree.nbytes == plain.nbytes + 3 * len(leaves)


@pytest.mark.parametrize("adaptive", [False, True])
def test_hits_are_those_of_the_reference(adaptive):
    octree = with_boxes(random_octree(adaptive=adaptive))
    missed = 0
    for camera in cameras(octree):
        assert_patch_rays(octree, camera, lookahead=2)
        node = first_hits(octree, camera).node
        missed += int((first_hits(replace(octree, leaf_box=None), camera).node != node).sum())
    assert missed > 10  # rays that have passed a box


@pytest.mark.parametrize("boxes", [True, False])
def test_a_thin_bar_is_as_wide_as_it_is(boxes):
    """A bar of 0.6 voxels across, from voxel to voxel, covers that share of the view, and two voxels without a box."""
    mesh = TriangleMesh.from_arrays(box((-0.3, 0.1, -4.0), (0.3, 0.4, 4.0)))
    grid, detail = Grid((-8.0, -8.0, -8.0), 16.0, 4), LeafDetail(boxes=boxes)
    octree = octree_of(mesh, position_shade, grid, exposure=1.0, detail=detail)
    axes = np.array([1.0, 0, 0]), np.array([0, 0, 1.0]), np.array([0, 1.0, 0])
    camera = Camera(np.array([0.0, -20.0, 0.0]), *axes, 4.0, 2.0, 8, 4, kind=ORTHOGRAPHIC)
    coverage = supersample_pixels(octree, camera, np.arange(32), 32).coverage.reshape(4, 8)
    width = coverage.sum(axis=1)  # pixels are as wide as voxels
    np.testing.assert_allclose(width, 0.6 if boxes else 2.0, atol=2 / STEPS)
