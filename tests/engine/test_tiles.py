# SPDX-License-Identifier: GPL-3.0-or-later
"""The compiled traversal of ray tiles against the plain reference, from all kinds of cameras."""

from dataclasses import replace

import numpy as np
import pytest

from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.patchnet_addon.tracing.camera import ORTHOGRAPHIC, Camera
from patchnet.patchnet_addon.tracing.render import fine_hits, first_hits, visits_per_ray
from patchnet.patchnet_addon.tracing.supersample import behind_patches
from patchnet.tests.engine.octree_samples import random_octree
from patchnet.tests.references.first_hits import hits_of_pixels, shown_by
from patchnet.training.benchmarks.shells import octree_of_shells


@pytest.fixture(scope="module")
def shells() -> Octree:
    return octree_of_shells(60_000)


def cameras(octree: Octree) -> list[Camera]:
    """Around, within, far away, along the axes, through a telescope, of parallel rays, clipped.

    No ray runs through an edge of voxels, where either neighbour may be met.
    """
    low, high = octree.grid.to_world(np.zeros(3)), octree.grid.to_world(np.ones(3))
    centre, side = (low + high) / 2, octree.grid.side_world

    def look(name: str, position: tuple[float, float, float], target=(0.02, 0.01, 0.03), fov=50.0) -> Camera:
        at, to = (centre + side * np.array(point) for point in (position, target))
        return Camera.look_at(at, to, fov=np.radians(fov), size_px=(37, 21), name=name)

    right, up, forward = np.eye(3)
    aside = side * np.array([0.0131, 0.0171, 0.0057])
    place, halves = centre + aside - 2 * side * forward, (0.6 * side, 0.4 * side)
    parallel = Camera(place, right, up, forward, *halves, 37, 21, kind=ORTHOGRAPHIC, shift_x=0.2)
    outside = look("outside", (1.1, -1.3, 0.7))
    return [
        outside,
        look("all signs", (0.01, 0.02, 0.0), (0.3, 0.1, 0.05), 120.0),
        look("far", (40.0, -30.0, 20.0), fov=1.2),
        look("very far", (4e3, -3e3, 2e3)),
        look("axis", (0.0131, -2.0, 0.0171), (0.0131, 0.0, 0.0171)),
        look("near", (0.26, 0.0131, 0.0171), (0.5, 0.0131, 0.0171), 70.0),
        look("away", (2.0, 0.0, 0.0), (3.0, 0.0, 0.0)),
        replace(parallel, name="parallel"),
        replace(outside, clip_start=1.2 * side, clip_end=1.7 * side, name="clipped"),
        replace(parallel, clip_start=1.6 * side, clip_end=2.1 * side, name="clipped parallel"),
    ]


def assert_hits(octree: Octree, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Of the walk, those of the reference, which are returned: node (P,) and t (P,)."""
    node, t = hits_of_pixels(octree, camera)
    hits = first_hits(octree, camera)
    np.testing.assert_array_equal(hits.node, node, err_msg=camera.name)
    np.testing.assert_allclose(hits.t_world, t * octree.grid.side_world, rtol=1e-6, err_msg=camera.name)
    return node, t


@pytest.mark.parametrize("size", [(8, 8), (37, 21), (5, 3), (1, 1)])
def test_hits_are_those_of_the_reference(shells, size):
    for camera in cameras(shells):
        assert_hits(shells, camera.with_size(*size))


def test_hits_in_a_random_octree():
    octree = random_octree()
    for camera in cameras(octree):
        node, _ = assert_hits(octree, camera)
        hits = first_hits(octree, camera)
        np.testing.assert_array_equal(hits.level[hits.hit], octree.level_of(node[hits.hit]))
        cells = [
            octree.cells(level)[n - octree.level_start[level]]
            for n, level in zip(node, hits.level, strict=True)
            if n >= 0
        ]
        np.testing.assert_array_equal(hits.cell[hits.hit], np.reshape(cells, (-1, 3)))


@pytest.mark.parametrize("lookahead", [1, 2, 3])
def test_finer_voxels_and_those_behind_patches_are_those_of_the_reference(shells, lookahead):
    for camera in cameras(shells):
        assert_patch_rays(shells, camera, lookahead)


def assert_patch_rays(octree: Octree, camera: Camera, lookahead: int) -> None:
    """Hits and finer voxels of one walk, and what is behind the patch, are those of three reference rays."""
    hits, fine = fine_hits(octree, camera, lookahead=lookahead)
    node, t = assert_hits(octree, camera)
    np.testing.assert_array_equal(hits.node, node)
    met, finer = node >= 0, 2.0 ** (lookahead + 1)
    np.testing.assert_array_equal(fine, np.where(met, shown_by(octree, hits_of_pixels(octree, camera, finer)[0]), 0.0))
    start = np.where(met, t, 0.0) + 1.5 * 0.5 ** octree.level_of(np.maximum(node, 0))
    np.testing.assert_allclose(hits.patch_end, np.where(met, start, np.inf), rtol=1e-12)
    beyond, _ = hits_of_pixels(octree, camera, finer, start)
    behind = behind_patches(octree, camera, hits, lookahead=lookahead)
    expected = np.where(met, shown_by(octree, beyond), np.float32(0.0))
    np.testing.assert_allclose(behind.luminance, expected, rtol=3e-7, err_msg=camera.name)
    np.testing.assert_array_equal(behind.coverage, met & (beyond >= 0), err_msg=camera.name)


def test_visits_per_ray_are_few(shells):
    """A ray of its own makes 15 to 30 steps here; tiles share theirs."""
    bounds = {"outside": 1.6, "all signs": 2.2, "far": 1.6, "away": 0.2}
    for camera in cameras(shells):
        if camera.name in bounds:
            visits = visits_per_ray(shells, camera.with_size(256, 192))
            assert 0.0 < visits < bounds[camera.name], camera.name
