# SPDX-License-Identifier: GPL-3.0-or-later
"""Coverage and luminance of patches against rays that are traced one by one (methods 7.16)."""

import numpy as np
import pytest

from patchnet.patchnet_addon.codes.patch_rays import PatchRays, render_patches
from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.tests.engine.octree_samples import octree_from_leaves, random_octree, with_boxes, with_sides
from patchnet.tests.references.patch_rays import render_patches_reference


@pytest.fixture(scope="module")
def octree() -> Octree:
    """Depth 6, with some leaves coarser than the rest, and sides."""
    return with_sides(random_octree(seed=3, depth=6, count=1500, adaptive=True))


def random_rays(octree: Octree, level: int, voxels: int, views: int, seed: int) -> PatchRays:
    random = np.random.default_rng(seed)
    cell = octree.cells(level)[random.integers(0, len(octree.cells(level)), voxels)]
    direction = random.standard_normal((voxels * views, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    up = random.standard_normal(direction.shape)
    up -= (up * direction).sum(1, keepdims=True) * direction
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    entry, ratio = random.uniform(0, 1, direction.shape), random.uniform(0.5, 1, len(direction))
    start = np.arange(voxels + 1) * views
    arrays = (array.astype(np.float32) for array in (entry, direction, up, ratio))
    return PatchRays(np.full(voxels, level, np.int32), cell, start, *arrays)


def assert_as_followed(octree: Octree, rays: PatchRays, lookahead: int = 2) -> None:
    coverage, luminance = render_patches(octree, rays, lookahead)
    expected_coverage, expected_luminance = render_patches_reference(octree, rays, lookahead)
    # A ray that grazes an edge may fall to either side: 2 of 4096.
    np.testing.assert_allclose(coverage, expected_coverage, rtol=0, atol=2 / 4096)
    np.testing.assert_allclose(luminance, expected_luminance, rtol=0, atol=2e-3)


@pytest.mark.parametrize(("level", "lookahead"), [(1, 2), (3, 2), (4, 2), (4, 1), (3, 3)])
def test_equals_rays_followed_one_by_one(octree: Octree, level: int, lookahead: int) -> None:
    assert_as_followed(octree, random_rays(octree, level, voxels=2, views=2, seed=level), lookahead)


@pytest.mark.parametrize("lookahead", [1, 2, 3])
def test_boxes_of_leaves(octree: Octree, lookahead: int) -> None:
    boxed = with_boxes(octree)
    rays = random_rays(octree, 6 - lookahead, voxels=2, views=2, seed=lookahead)
    assert_as_followed(boxed, rays, lookahead)
    assert render_patches(boxed, rays, lookahead)[0].sum() < render_patches(octree, rays, lookahead)[0].sum()


@pytest.mark.parametrize(("axis", "sign", "boxes"), [(0, 1.0, False), (1, -1.0, True), (2, 1.0, True)])
def test_views_along_an_axis(octree: Octree, axis: int, sign: float, boxes: bool) -> None:
    """Two slabs of the outline vanish there."""
    octree = with_boxes(octree) if boxes else octree
    rays = random_rays(octree, 4, voxels=2, views=1, seed=9)
    rays.direction[:] = sign * np.eye(3)[axis]
    rays.up[:] = np.eye(3)[(axis + 1) % 3]
    rays.entry_voxel[:] = 0.5371
    assert_as_followed(octree, rays)


def test_coarser_leaf_is_solid() -> None:
    """Seen along an axis, a leaf in an otherwise empty cube covers exactly its own square."""
    octree = octree_from_leaves({(0, (0, 0, 0)): (1.0, 0.4, (0.0, 0.0, 1.0))}, 4)
    rays = PatchRays(
        np.array([1]), np.array([[0, 0, 0]]), np.array([0, 1]),
        np.array([[0.5, 0.5, 0.0]]), np.array([[0, 0, 1.0]]), np.array([[0, 1.0, 0]]), np.array([1.0]),
    )  # fmt: skip
    coverage, luminance = render_patches(octree, rays)
    assert coverage[0] == 1.0
    assert luminance[0] == pytest.approx(octree.luminance_float(np.array([0]))[0], abs=1e-6)
    rays.entry_voxel[0, 0] = 0.0  # half of the viewport now looks past the octree
    assert render_patches(octree, rays)[0][0] == 0.5
