# SPDX-License-Identifier: GPL-3.0-or-later
"""Camera-fitted octrees: look-ahead in every pixel, few leaves elsewhere."""

import numpy as np
import pytest

from patchnet.patchnet_addon.lod.fit import fit_leaf_levels, needed_levels
from patchnet.patchnet_addon.lod.fitted_levels import BLOCK_LEVEL
from patchnet.patchnet_addon.lod.stops import FINE_OFFSETS, bands_of
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.runtime.errors import GeometryError
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.mesh import Material, Texture, TriangleMesh
from patchnet.patchnet_addon.surface.shading import albedo_shade, opacity_shade
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.patchnet_addon.tracing.render import first_hits
from patchnet.tests.references.first_hits import needed_levels_reference

from .mesh_samples import even, in_batches, octree_of
from .octree_samples import random_octree
from .test_seen_cells import cameras


def quad(origin, a, b):
    origin, a, b = (np.array(value, float) for value in (origin, a, b))
    return [[origin, origin + a, origin + a + b], [origin, origin + a + b, origin + b]]


@pytest.fixture(scope="module")
def mesh():
    """A long floor, a grating of laths across it, and a wall behind that."""
    parts = [*quad((-1, -1, 0), (2, 0, 0), (0, 2, 0)), *quad((-1, 0.9, 0), (2, 0, 0), (0, 0, 1))]
    for x in np.linspace(-0.9, 0.9, 30):
        parts += quad((x, 0.2, 0), (0.02, 0, 0), (0, 0, 0.6))
    return TriangleMesh.from_arrays(np.array(parts))


@pytest.fixture(scope="module")
def camera():
    return Camera.look_at(np.array([0.1, -0.9, 0.25]), np.array([0.0, 0.5, 0.2]), size_px=(288, 192))


@pytest.fixture(scope="module")
def fitted(mesh, camera):
    return drain(fit_leaf_levels(mesh, Grid.around(mesh.bounds_world, 9), [camera], even()))


@pytest.fixture(scope="module")
def octree(mesh, fitted):
    return octree_of(mesh, even(), 12, layout=fitted.layout)


def share_of(octree, camera):
    hits = first_hits(octree, camera)
    return octree.look_ahead()[hits.node[hits.hit]].mean()


INSIDE, FAR, PARALLEL = cameras(40, 30)


@pytest.mark.parametrize("camera", [INSIDE, FAR, PARALLEL], ids=["inside", "far", "orthographic"])
@pytest.mark.parametrize(("block_level", "offsets"), [(2, FINE_OFFSETS), (4, FINE_OFFSETS), (4, FINE_OFFSETS[1:2])])
def test_needed_levels_equal_the_reference(camera, block_level, offsets):
    octree = random_octree(seed=3, depth=6, count=500, adaptive=True)
    needed, pixels = np.zeros(8**block_level, np.uint8), np.zeros(8**block_level, np.uint32)
    drain(needed_levels(octree.nodes, octree.grid, camera, needed, pixels, fine_offsets=offsets))
    expected = needed_levels_reference(octree, camera, block_level, np.array(offsets))
    assert expected.max() > block_level
    np.testing.assert_array_equal(needed, expected)
    assert pixels.sum() == first_hits(octree, camera).hit.sum()


def test_rays_that_lie_farther_apart_ask_for_what_pixels_ask_for():
    octree, camera = random_octree(seed=3, depth=6, count=500, adaptive=True), FAR
    counts = 8**4
    one, two, pixels = np.zeros(counts, np.uint8), np.zeros(counts, np.uint8), np.zeros(counts, np.uint32)
    drain(needed_levels(octree.nodes, octree.grid, camera, one, pixels))
    drain(needed_levels(octree.nodes, octree.grid, camera.with_size(20, 15), two, pixels, coarser=1))
    fewer = needed_levels_reference(octree, camera.with_size(20, 15), 4, np.array(FINE_OFFSETS), coarser=1)
    np.testing.assert_array_equal(two, fewer)
    assert set(two[two > 0]) == set(one[one > 0]) and 0 < (two > 0).sum() < (one > 0).sum()


def test_rows_of_tiles_together_ask_for_what_the_picture_asks_for():
    octree, camera = random_octree(seed=3, depth=6, count=500, adaptive=True), FAR
    whole, parts = (np.zeros(8**4, np.uint8) for _ in range(2))
    pixels, counted = (np.zeros(8**4, np.uint32) for _ in range(2))
    drain(needed_levels(octree.nodes, octree.grid, camera, whole, pixels))
    rows = -(-camera.height_px // 8)
    for first in range(3):
        drain(needed_levels(octree.nodes, octree.grid, camera, parts, counted, bands=range(first, rows, 3)))
        assert first == 2 or counted.sum() < pixels.sum()
    np.testing.assert_array_equal(parts, whole)
    np.testing.assert_array_equal(counted, pixels)


def test_frames_of_a_long_track_have_rays_in_other_rows_each():
    assert bands_of(3, 4, 100) == bands_of(30, 49, 100) == range(13)
    share = [bands_of(number, 1000, 800) for number in range(1000)]
    assert {rows.step for rows in share} == {10} and {rows.start for rows in share} == set(range(10))
    for rows in (share[number : number + 30] for number in range(0, 900, 30)):  # a second of a film
        assert {row for each in rows for row in each} == set(range(100))


def test_a_short_shot_of_a_long_track_is_fitted(mesh):
    """Eight frames look at the other end of the floor, from near; nothing else does."""
    shot = Camera.look_at(np.array([0.8, -0.5, 0.1]), np.array([0.8, -0.9, 0.0]), size_px=(96, 64))
    away = Camera.look_at(np.array([0.1, 0.5, 0.25]), np.array([0.0, 0.9, 0.2]), size_px=(96, 64))
    shares = []
    for track in ([away] * 81, [*[away] * 41, *[shot] * 8, *[away] * 32]):
        layout = drain(fit_leaf_levels(mesh, Grid.around(mesh.bounds_world, 9), track, even())).layout
        octree = octree_of(mesh, even(), 12, layout=layout)
        shares.append((share_of(octree, shot), share_of(octree, away)))
    assert shares[0][0] < 0.1 and min(*shares[1], shares[0][1]) > 0.97


def test_all_pixels_have_look_ahead_with_far_fewer_leaves(mesh, camera, fitted, octree):
    assert share_of(octree, camera) > 0.99 and fitted.lookahead_share == 1.0
    assert octree.depth == fitted.layout.deepest == fitted.wanted
    assert octree.leaf_count == pytest.approx(fitted.leaves, rel=0.05)
    uniform = octree_of(mesh, even(), 10)
    assert share_of(uniform, camera) < 0.9 and octree.leaf_count < uniform.leaf_count


def test_fewer_leaves_where_memory_is_short(mesh, camera, fitted):
    grid = Grid.around(mesh.bounds_world, 9)
    less = drain(fit_leaf_levels(mesh, grid, [camera], even(), max_leaves=0.6 * fitted.leaves))
    assert less.leaves < 0.7 * fitted.leaves
    octree = octree_of(mesh, even(), 12, layout=less.layout)
    assert 0.3 < share_of(octree, camera) < 0.99
    assert less.lookahead_share == pytest.approx(share_of(octree, camera)) and octree.leaf_count == less.leaves
    bounded = drain(fit_leaf_levels(mesh, grid, [camera], even(), deepest=9))
    assert bounded.layout.deepest == 9 < bounded.wanted and bounded.lookahead_share < 0.9


def test_a_track_serves_all_its_cameras(mesh, camera):
    other = Camera.look_at(np.array([-0.8, 0.5, 0.5]), np.array([0.8, 0.8, 0.0]), size_px=(96, 64))
    fitted = drain(fit_leaf_levels(mesh, Grid.around(mesh.bounds_world, 9), [camera, other], even()))
    octree = octree_of(mesh, even(), 12, layout=fitted.layout)
    assert min(share_of(octree, view) for view in (camera, other)) > 0.99


def test_a_camera_that_looks_away_asks_for_nothing(mesh):
    away = Camera.look_at(np.array([0.0, -3.0, 0.5]), np.array([0.0, -9.0, 0.5]), size_px=(16, 16))
    fitted = drain(fit_leaf_levels(mesh, Grid.around(mesh.bounds_world, 9), [away], even()))
    assert fitted.layout.used == (BLOCK_LEVEL,) and fitted.lookahead_share is None


def test_the_estimate_is_about_the_fitted_octree(mesh, camera, fitted):
    grid = Grid.around(mesh.bounds_world, 9)
    rough = drain(fit_leaf_levels(mesh, grid, [camera], even(), rough=True))
    assert 0.4 * fitted.leaves < rough.leaves < 1.5 * fitted.leaves and rough.lookahead_share == 1.0
    assert abs(rough.layout.deepest - fitted.layout.deepest) <= 1
    less = drain(fit_leaf_levels(mesh, grid, [camera], even(), max_leaves=0.5 * rough.leaves, rough=True))
    assert less.leaves <= 0.5 * rough.leaves
    none = drain(fit_leaf_levels(mesh, grid, [camera], even(), max_leaves=0.0, rough=True))
    assert none.layout.used == (BLOCK_LEVEL,) and none.lookahead_share < 0.1


def test_transparent_surfaces_are_refused(mesh, camera):
    with pytest.raises(GeometryError, match="transparent"):
        drain(fit_leaf_levels(mesh, Grid.around(mesh.bounds_world, 9), [camera], even(0.0, 0.0)))


def test_cut_outs_leave_no_coarse_leaves_in_the_picture(camera):
    """A gap that the fit finds must be one in the lit octree, too."""
    rng = np.random.default_rng(7)
    alpha = np.kron(rng.random((24, 24)) > 0.7, np.ones((3, 3))).astype(np.float32)[..., None]
    leaves = Material("leaves", alpha_texture=Texture("alpha", alpha), alpha_threshold=0.5)
    quads = np.array([*quad((-1, 0.9, 0), (2, 0, 0), (0, 0, 1)), *quad((-0.6, 0.1, 0), (1.2, 0.1, 0), (0, 0.05, 0.6))])
    uvs = np.array([[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]] * 2, np.float32)
    batches = in_batches(quads, (), uvs, np.array([0, 0, 1, 1], np.int32))
    source = TriangleMesh(batches, (Material("wall"), leaves))
    fitted = drain(fit_leaf_levels(source, Grid.around(source.bounds_world, 9), [camera], opacity_shade(source)))
    octree = octree_of(source, albedo_shade(source), 12, layout=fitted.layout)
    assert fitted.layout.deepest > BLOCK_LEVEL + 1 and share_of(octree, camera) > 0.998
