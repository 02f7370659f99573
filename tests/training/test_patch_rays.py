# SPDX-License-Identifier: GPL-3.0-or-later
"""Coverage and luminance of patches against rays that are followed one by one through the cubes (methods 7.16)."""

import numpy as np
import pytest

from patchnet.patchnet_addon.codes.brick import brick_nodes
from patchnet.patchnet_addon.codes.patch_rays import PatchRays, render_patches
from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.training.procedural import prune, spheres_and_slats


@pytest.fixture(scope="module")
def octree() -> Octree:
    """Depth 6, with some leaves coarser than the rest."""
    full = spheres_and_slats(6, seed=3)
    coarse = [full.level_start[level] + np.arange(0, 20) * 7 for level in (3, 4, 5)]
    nodes = np.concatenate(coarse)
    return prune(full, nodes[nodes < full.level_start[6]])


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


def march(octree: Octree, rays: PatchRays, group: int, ray: int) -> tuple[float, float]:
    """Coverage and luminance by the slab test of 4096 rays against every occupied cube, in float64."""
    nodes = brick_nodes(octree, int(rays.level[group]), rays.cell[group])
    there = np.argwhere(nodes >= 0)[:, ::-1] / 4 - 1.0  # lowest corners in voxels, x y z
    luminance = octree.luminance_float(nodes[nodes >= 0])
    direction, up = rays.direction[ray].astype(np.float64), rays.up[ray].astype(np.float64)
    along = (np.arange(64) + 0.5) / 64 - 0.5
    across, upward = np.meshgrid(along * rays.ratio[ray], along * rays.ratio[ray])
    origin = rays.entry_voxel[ray] + across.reshape(-1, 1) * np.cross(direction, up) + upward.reshape(-1, 1) * up
    middle = np.abs((there + 0.125 - rays.entry_voxel[ray]) @ np.stack([np.cross(direction, up), up], 1)).max(1)
    there, luminance = there[middle < 0.75], luminance[middle < 0.75]  # the rest is outside of the viewport
    with np.errstate(divide="ignore", invalid="ignore"):
        first = (there - origin[:, None]) / direction
        second = (there + 0.25 - origin[:, None]) / direction
    enter, leave = np.minimum(first, second).max(2), np.maximum(first, second).min(2)
    enter = np.where(enter <= leave, enter, np.inf)
    hit = np.isfinite(enter).any(1)
    return float(hit.mean()), float(luminance[enter.argmin(1)][hit].mean()) if hit.any() else 0.0


@pytest.mark.parametrize("level", [1, 3, 4])
def test_equals_rays_followed_one_by_one(octree: Octree, level: int) -> None:
    rays = random_rays(octree, level, voxels=3, views=2, seed=level)
    coverage, luminance = render_patches(octree, rays)
    for ray in range(6):
        expected = march(octree, rays, ray // 2, ray)
        # A ray that grazes an edge may fall to either side: 2 of 4096.
        assert abs(coverage[ray] - expected[0]) <= 2 / 4096
        assert abs(luminance[ray] - expected[1]) < 2e-3


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_views_along_an_axis(octree: Octree, axis: int, sign: float) -> None:
    """Two slabs of the outline vanish there."""
    rays = random_rays(octree, 4, voxels=2, views=1, seed=9)
    rays.direction[:] = sign * np.eye(3)[axis]
    rays.up[:] = np.eye(3)[(axis + 1) % 3]
    rays.entry_voxel[:] = 0.5371
    coverage, luminance = render_patches(octree, rays)
    for ray in range(2):
        expected = march(octree, rays, ray, ray)
        assert abs(coverage[ray] - expected[0]) <= 2 / 4096
        assert abs(luminance[ray] - expected[1]) < 2e-3


def test_coarser_leaf_is_solid() -> None:
    """Seen along an axis, a leaf in an otherwise empty cube covers exactly its own square."""
    octree = prune(spheres_and_slats(4, seed=1), np.array([0]))
    rays = PatchRays(
        np.array([1]), np.array([[0, 0, 0]]), np.array([0, 1]),
        np.array([[0.5, 0.5, 0.0]]), np.array([[0, 0, 1.0]]), np.array([[0, 1.0, 0]]), np.array([1.0]),
    )  # fmt: skip
    coverage, luminance = render_patches(octree, rays)
    assert coverage[0] == 1.0
    assert luminance[0] == pytest.approx(octree.luminance_float(np.array([0]))[0], abs=1e-6)
    rays.entry_voxel[0, 0] = 0.0  # half of the viewport now looks past the octree
    assert render_patches(octree, rays)[0][0] == 0.5
