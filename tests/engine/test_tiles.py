# SPDX-License-Identifier: GPL-3.0-or-later
"""Tiles of rays against rays one at a time: the same hits, to the bit."""

from dataclasses import replace

import numpy as np
import pytest

from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.patchnet_addon.tracing.camera import ORTHOGRAPHIC, Camera
from patchnet.patchnet_addon.tracing.render import first_hits, patch_hits, visits_per_ray
from patchnet.patchnet_addon.tracing.supersample import supersample_pixels
from patchnet.tests.engine.octree_samples import random_octree
from patchnet.tests.references.single_rays import single_hits, single_means
from patchnet.training.benchmarks.shells import octree_of_shells

SIZES = [(8, 8), (37, 21), (5, 3), (1, 1), (64, 48)]


@pytest.fixture(scope="module")
def shells() -> Octree:
    return octree_of_shells(60_000)


def cameras(octree: Octree) -> list[Camera]:
    """Around, within, far away, along the axes, through a telescope, of parallel rays, clipped."""
    low, high = octree.grid.to_world(np.zeros(3)), octree.grid.to_world(np.ones(3))
    centre, side = (low + high) / 2, octree.grid.side_world

    def look(name: str, position: tuple[float, float, float], target=(0.02, 0.01, 0.03), fov=50.0) -> Camera:
        at, to = (centre + side * np.array(point) for point in (position, target))
        return Camera.look_at(at, to, fov=np.radians(fov), size_px=(37, 21), name=name)

    right, up, forward = np.eye(3)
    parallel = Camera(
        centre - 2 * side * forward, right, up, forward, 0.6 * side, 0.4 * side, 37, 21, kind=ORTHOGRAPHIC, shift_x=0.2
    )
    outside = look("outside", (1.1, -1.3, 0.7))
    return [
        outside,
        look("all signs", (0.01, 0.02, 0.0), (0.3, 0.1, 0.05), 120.0),
        look("far", (40.0, -30.0, 20.0), fov=1.2),
        look("very far", (4e3, -3e3, 2e3)),
        look("axis", (0.0, -2.0, 0.0), (0.0, 0.0, 0.0)),
        look("near", (0.26, 0.0, 0.0), (0.5, 0.0, 0.0), 70.0),
        look("away", (2.0, 0.0, 0.0), (3.0, 0.0, 0.0)),
        replace(parallel, name="parallel"),
        replace(outside, clip_start=1.2 * side, clip_end=1.7 * side, name="clipped"),
    ]


@pytest.mark.parametrize("size", SIZES)
def test_hits_are_those_of_single_rays(shells, size):
    for camera in cameras(shells):
        seen = camera.with_size(*size)
        hits = first_hits(shells, seen)
        node, level, t = single_hits(shells, seen)
        np.testing.assert_array_equal(hits.node, node, err_msg=camera.name)
        np.testing.assert_array_equal(hits.level, level, err_msg=camera.name)
        expected = (t * shells.grid.side_world).astype(np.float32)
        np.testing.assert_array_equal(hits.t_world, expected, err_msg=camera.name)
        cells = np.stack([shells.cells(one)[at - shells.level_start[one]] for at, one in zip(node, level, strict=True)])
        np.testing.assert_array_equal(hits.cell[hits.hit], cells[hits.hit], err_msg=camera.name)


@pytest.mark.parametrize("seed", range(4))
def test_hits_in_random_octrees(seed):
    octree = random_octree(seed=seed)
    for camera in cameras(octree):
        np.testing.assert_array_equal(first_hits(octree, camera).node, single_hits(octree, camera)[0])


@pytest.mark.parametrize("lookahead", [1, 2, 3])
def test_one_walk_has_the_answers_of_three(shells, lookahead):
    for camera in cameras(shells):
        found = patch_hits(shells, camera, lookahead=lookahead)
        node, level, t = single_hits(shells, camera)
        np.testing.assert_array_equal(found.hits.node, node, err_msg=camera.name)
        finer = 2.0 ** (lookahead + 1)
        met = node >= 0
        fine, _, _ = single_hits(shells, camera, finer)
        np.testing.assert_array_equal(found.fine[met], seen(shells, fine)[met], err_msg=camera.name)
        start = np.where(met, t, 0.0) + 1.5 * 0.5**level
        beyond, _, _ = single_hits(shells, camera, finer, start)
        np.testing.assert_array_equal(found.behind[met], seen(shells, beyond)[met], err_msg=camera.name)
        assert not found.fine[~met].any() and not found.behind[~met].any()
        ended = patch_hits(shells, camera, lookahead=lookahead, behind=False)
        np.testing.assert_array_equal(ended.fine, found.fine, err_msg=camera.name)
        assert ended.behind is None and np.array_equal(ended.hits.node, found.hits.node)


def seen(octree: Octree, nodes: np.ndarray) -> np.ndarray:
    return np.where(nodes >= 0, octree.luminance_float(np.maximum(nodes, 0)), np.float32(0.0))


@pytest.mark.parametrize("side", [1, 2, 3, 4, 8, 9, 16, 32])
def test_means_are_those_of_single_rays(shells, side):
    for camera in cameras(shells)[:3]:
        pixels = np.random.default_rng(side).integers(0, camera.pixel_count, 40)
        found = supersample_pixels(shells, camera, pixels, side)
        np.testing.assert_allclose(found.luminance, single_means(shells, camera, pixels, side), atol=1e-7)


def test_visits_per_ray_are_few(shells):
    """A ray of its own makes 15 to 30 steps here; tiles share theirs."""
    bounds = {"outside": 1.6, "all signs": 2.2, "far": 1.6, "away": 0.2}
    for camera in cameras(shells):
        if camera.name in bounds:
            visits = visits_per_ray(shells, camera.with_size(256, 192))
            assert 0.0 < visits < bounds[camera.name], camera.name
