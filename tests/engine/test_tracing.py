# SPDX-License-Identifier: GPL-3.0-or-later
"""Clipping, the contract of hits, supersampling and colour."""

from dataclasses import replace

import numpy as np
import pytest

from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.mesh import TriangleMesh
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.patchnet_addon.tracing.ray_up import ray_up
from patchnet.patchnet_addon.tracing.render import first_hits, seen_color
from patchnet.patchnet_addon.tracing.supersample import behind_patches, supersample
from patchnet.tests.engine.mesh_samples import even, octree_of, square
from patchnet.tests.engine.octree_samples import random_octree
from patchnet.tests.references.first_hits import supersampled_reference
from patchnet.tests.references.small import ray_up_reference

CAMERA = Camera.look_at(np.array([2.0, 1.6, 1.35]), np.full(3, 0.5), size_px=(24, 20))


@pytest.fixture(scope="module")
def octree():
    return random_octree(seed=4, depth=6, count=2500)


def test_clipping_takes_what_is_nearer_and_farther(octree):
    """Between planes along the view axis, to the accuracy of a voxel."""
    whole = first_hits(octree, CAMERA)
    middle = float(np.median(whole.z_world[whole.hit]))
    near, far = (first_hits(octree, replace(CAMERA, **clip)) for clip in ({"clip_end": middle}, {"clip_start": middle}))
    assert near.z_world[near.hit].max() <= middle * (1 + 1e-6)
    assert (near.hit == (whole.hit & (whole.z_world <= middle * (1 + 1e-6)))).mean() > 0.99
    assert far.hit.any() and far.z_world[far.hit].min() >= middle * (1 - 1e-6)
    assert not first_hits(octree, replace(CAMERA, clip_end=0.5)).hit.any()
    assert not first_hits(octree, replace(CAMERA, clip_start=50.0)).hit.any()


def test_contract_holds_at_every_hit(octree):
    hits = first_hits(octree, CAMERA)
    side_voxel = octree.grid.side_world * 0.5 ** hits.level[hits.hit]
    side_pixel = CAMERA.pixel_side(hits.z_world[hits.hit])
    leaf = octree.child_mask[hits.node[hits.hit]] == 0
    assert (leaf | (side_voxel < 2 * side_pixel * (1 + 1e-6))).all()
    np.testing.assert_allclose(hits.ratio[hits.hit], np.clip(side_pixel / side_voxel, 0.5, 1), rtol=1e-5)
    assert (np.abs((hits.up * hits.direction).sum(axis=1)) < 1e-6).all()


@pytest.mark.parametrize("side", [2, 4, 9])
def test_supersampling_equals_mean_of_reference_rays(octree, side):
    camera = CAMERA.with_size(6, 5)
    picture = drain(supersample(octree, camera, side)).luminance
    expected, _ = supersampled_reference(octree, camera, side)
    np.testing.assert_allclose(picture, expected, atol=1e-6)


def test_colour_of_pictures(octree):
    """Equal to the plain twin, with the luminance of the gray pictures to the bit."""
    chroma = np.random.default_rng(0).integers(0, 128, (octree.node_count, 2)).astype(np.uint8)
    colored, camera = replace(octree, chroma=chroma), CAMERA.with_size(9, 7)
    luminance, colors, _ = drain(supersample(colored, camera, 3))
    np.testing.assert_array_equal(luminance, drain(supersample(octree, camera, 3)).luminance)
    np.testing.assert_allclose(colors, supersampled_reference(colored, camera, 3)[1], atol=1e-5)
    np.testing.assert_allclose(colors @ (0.2126, 0.7152, 0.0722), luminance, atol=1e-6)
    hits = first_hits(colored, camera)
    seen = seen_color(colored, hits.node, hits.direction)
    np.testing.assert_allclose(seen @ (0.2126, 0.7152, 0.0722), hits.luminance, atol=1e-6)
    np.testing.assert_allclose(seen, drain(supersample(colored, camera, 1)).colors, atol=1e-6)
    gray = seen_color(octree, hits.node, hits.direction)
    np.testing.assert_array_equal(gray, np.repeat(hits.luminance[:, None], 3, axis=1))


def test_behind_sees_the_second_of_two_sheets():
    mesh = TriangleMesh.from_arrays(np.concatenate([square(0.5, -1, 1), square(-0.5, -1, 1)]))
    octree = octree_of(mesh, even(np.repeat([0.9, 0.2], 2)), 7, exposure=1.0)
    camera = Camera.look_at(np.array([0.001, 0.002, 4.0]), np.zeros(3), up_world=(0, 1, 0), size_px=(8, 8))
    hits = first_hits(octree, camera)
    np.testing.assert_allclose(hits.luminance[hits.hit], 0.9, atol=1e-4)
    seen = behind_patches(octree, camera, hits).luminance[hits.hit]
    assert np.median(seen) == pytest.approx(0.2, abs=1e-4)
    assert set(np.round(np.unique(seen), 3)) <= {np.float32(0.0), np.float32(0.2)}


def test_picture_up_of_rays():
    """float32 of float64: a unit in the last place where the sums are rounded otherwise."""
    rng = np.random.default_rng(0)
    direction = rng.normal(size=(501, 3)).astype(np.float32)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    up = np.array([0.1, -0.3, 0.8])
    found = ray_up(direction, up)
    np.testing.assert_allclose(found, ray_up_reference(direction, up), rtol=3e-7, atol=1e-12)
    np.testing.assert_allclose((found * direction).sum(axis=1), 0.0, atol=1e-6)
    assert ray_up(direction[:0], up).shape == (0, 3)
