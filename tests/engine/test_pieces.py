# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays that end on the pieces of leaves against all triangles; light, textures, holes, limits, files."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from patchnet.patchnet_addon.octree import collect_pieces
from patchnet.patchnet_addon.octree.file import load_octree, octree_hash, save_octree
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.leaf_levels import LeafLevels
from patchnet.patchnet_addon.octree.pieces import LAST, NO_PIECES, PIECES_VERSION, TRIANGLE
from patchnet.patchnet_addon.octree.voxelize import LeafDetail
from patchnet.patchnet_addon.runtime.errors import OctreeFileError
from patchnet.patchnet_addon.runtime.kernels import kernel
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.mesh import Material, Texture, TriangleMesh
from patchnet.patchnet_addon.surface.shading import albedo_shade, two_lights_shade
from patchnet.patchnet_addon.surface.texture_lookup import BaseColors
from patchnet.patchnet_addon.surface.textures import TextureTable
from patchnet.patchnet_addon.surface.triangles import triangle_areas_and_normals
from patchnet.patchnet_addon.tracing.camera import ORTHOGRAPHIC, Camera
from patchnet.patchnet_addon.tracing.render import first_hits
from patchnet.patchnet_addon.tracing.supersample import behind_patches, supersample, supersample_pixels
from patchnet.tests.references.first_hits import picture_points, pixel_rays
from patchnet.tests.references.triangle_hits import nearest_triangles, unpacked_light

from .mesh_samples import even, in_batches, octree_of, square
from .octree_samples import random_octree

SIZE = 40, 28
GRID = Grid((0.0, 0.0, 0.0), 1.0, 6)
WHITE = Material("white", (1.0, 1.0, 1.0))


def soup(count: int = 50, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.clip(rng.uniform(0.2, 0.8, (count, 1, 3)) + rng.normal(0.0, 0.12, (count, 3, 3)), 0.01, 0.99)


def quad(height: float, low: float = 0.1, high: float = 0.9) -> TriangleMesh:
    """A square that faces up, with UV coordinates from 0 to 1."""
    corners = square(height, low, high)
    uvs = ((corners[..., :2] - low) / (high - low)).astype(np.float32)
    return TriangleMesh(in_batches(corners, (), uvs), (WHITE,))


def painted(mesh: TriangleMesh, *materials: Material) -> TriangleMesh:
    return TriangleMesh(mesh.parts, materials)


def exact(mesh: TriangleMesh, shade=None, *, color: bool = False, boxes: bool = True, **settings):
    base = BaseColors(TextureTable.from_materials(mesh.materials, color=color), np.ones(len(mesh.materials), bool))
    detail = LeafDetail(boxes=boxes, base=base)
    shade = shade or albedo_shade(mesh, color=color)
    return octree_of(mesh, shade, settings.pop("grid", GRID), exposure=1.0, detail=detail, **settings)


def above(size=SIZE, **settings) -> Camera:
    eye = np.array([0.5, 0.5001, 3.0])
    return Camera.look_at(eye, np.array([0.5, 0.5, 0.0]), size_px=size, **settings)


def flat(camera: Camera, half: float) -> Camera:
    return replace(camera, kind=ORTHOGRAPHIC, half_x=half * camera.width_px / camera.height_px, half_y=half)


def seen(octree, camera, side: int = 1, finer: float = 64.0):
    """Means of all pixels whose rays reach leaves."""
    return supersample_pixels(octree, camera, np.arange(camera.pixel_count), side, finer=finer)


def lights_of(mesh: TriangleMesh) -> np.ndarray:
    """Luminance (T,) of white triangles in the two lights of the paper."""
    normals = triangle_areas_and_normals(mesh.parts[0].corners_world)[1]
    return np.abs(normals @ (0.36, -0.48, 0.8))


def reference(mesh: TriangleMesh, octree, camera: Camera, begin: np.ndarray | float = 0.0):
    """Hits of the rays through the pixels' centres, from the lengths `begin` (P,) on."""
    origin, direction, _ = pixel_rays(octree.grid, camera, *picture_points(camera))
    corners = np.concatenate([part.corners_world for part in mesh.parts])
    return nearest_triangles(octree.grid.to_unit(corners), origin + np.expand_dims(begin, -1) * direction, direction)


def random_layout(seed: int) -> LeafLevels:
    return LeafLevels(np.random.default_rng(seed).integers(4, 7, 64).astype(np.uint8))


CORNERS = list(itertools.product((-0.4, 1.4), repeat=3))


@pytest.mark.parametrize("layout", [None, random_layout(1)], ids=["even", "levels"])
@pytest.mark.parametrize("kind", ["perspective", "orthographic"])
@pytest.mark.parametrize("eye", CORNERS)
def test_rays_end_on_the_nearest_triangle(eye, kind, layout):
    """From all eight corners, so that rays run up and down along each axis."""
    mesh = TriangleMesh.from_arrays(soup(), (WHITE,))
    octree = exact(mesh, two_lights_shade(mesh), layout=layout)
    camera = Camera.look_at(np.array(eye), np.array([0.5, 0.51, 0.48]), size_px=SIZE)
    if kind == "orthographic":
        camera = flat(camera, 0.5)
    nearest, *_ = reference(mesh, octree, camera)
    expected = np.where(nearest >= 0, lights_of(mesh)[nearest], 0.0)
    means = seen(octree, camera)
    wrong = np.abs(means.luminance - expected) > 2e-3
    assert wrong.mean() < 2e-3, "but for rays through edges"
    assert np.count_nonzero((means.coverage > 0.5) != (nearest >= 0)) <= 2
    boxes = seen(octree.without_pieces(), camera)
    assert (np.abs(boxes.luminance - expected) > 2e-3).mean() > 10 * wrong.mean() + 0.01


def test_rays_behind_patches_end_on_the_nearest_triangle_from_there():
    mesh = TriangleMesh.from_arrays(soup(), (WHITE,))
    octree = exact(mesh, two_lights_shade(mesh))
    camera = Camera.look_at(np.array([-0.4, 1.4, 1.4]), np.array([0.5, 0.51, 0.48]), size_px=SIZE)
    hits = first_hits(octree, camera)
    nearest, *_ = reference(mesh, octree, camera, np.where(hits.hit, hits.patch_end, 0.0))
    expected = np.where(hits.hit & (nearest >= 0), lights_of(mesh)[nearest], 0.0)
    wrong = np.abs(behind_patches(octree, camera, hits).luminance - expected) > 2e-3
    assert wrong.mean() < 5e-3 and (expected > 0.0).mean() > 0.05
    boxes = behind_patches(octree.without_pieces(), camera, hits).luminance
    assert (np.abs(boxes - expected) > 2e-3).mean() > 5 * wrong.mean() + 0.01


def test_rays_that_end_on_boxes_are_as_without_pieces():
    mesh = TriangleMesh.from_arrays(soup(), (WHITE,))
    shade, camera = two_lights_shade(mesh), above()
    plain = octree_of(mesh, shade, GRID, exposure=1.0, detail=LeafDetail(boxes=True))
    octree = exact(mesh, shade)
    for own, other in zip(seen(octree.without_pieces(), camera, 2), seen(plain, camera, 2), strict=True):
        np.testing.assert_array_equal(own, other)
    inner = octree.child_mask > 0
    np.testing.assert_array_equal(octree.first_child[inner], plain.first_child[inner])


def two_sides(lit):
    """Shade of light 0.25 in front, 0.75 behind."""

    def shade(batch, fragments):
        lights = np.repeat(np.array([[[0.25], [0.75]]], np.float32), len(fragments), axis=0)
        return even(0.25)(batch, fragments)._replace(sides=lights, lit=np.full(len(batch), lit, np.int8))

    return shade


@pytest.mark.parametrize(("lit", "top", "bottom"), [(0, 0.25, 0.75), (1, 0.25, 0.25), (-1, 0.75, 0.75)])
def test_rays_see_the_light_of_the_side_they_meet(lit, top, bottom):
    mesh = quad(0.5)
    octree = exact(mesh, two_sides(lit))
    below = replace(above(), position_world=np.array([0.5, 0.5001, -2.0]), forward=-above().forward)
    for camera, expected in ((above(), top), (below, bottom)):
        means = seen(octree, camera)
        met = means.coverage > 0.5
        assert met.any()
        np.testing.assert_allclose(means.luminance[met], expected, rtol=3e-3)


def stripes(texels: int) -> np.ndarray:
    """Bars two texels wide, (texels, texels, 3)."""
    values = np.where(np.arange(texels) // 2 % 2, 0.9, 0.1)
    return np.repeat(np.repeat(values[None, :, None], texels, axis=0), 3, axis=2).astype(np.float32)


@pytest.mark.parametrize("color", [False, True])
def test_textures_are_as_sharp_as_pixels(color):
    """64 bars over leaves of 4 bars each: pixels see bars, boxes their mean."""
    pixels = stripes(128) * np.array([1.0, 0.6, 0.3], np.float32)
    mesh = painted(quad(0.5), Material("bars", (1.0, 1.0, 1.0), base_texture=Texture("bars", pixels)))
    octree = exact(mesh, color=color, grid=Grid((0.0, 0.0, 0.0), 1.0, 4))
    camera = flat(above((160, 160)), 0.2)
    nearest, _, weights, _ = reference(mesh, octree, camera)
    uvs = np.concatenate([part.uvs for part in mesh.parts])[nearest]
    u = uvs[:, 0, 0] + (weights * (uvs[:, 1:, 0] - uvs[:, :1, 0])).sum(axis=1)
    bright = (u * 128).astype(int) // 2 % 2 == 1
    within = np.abs((u * 64) % 1.0 - 0.5) < 0.2  # away from the edges of bars
    means = seen(octree, camera)
    luminance = 0.9 * pixels[0, 2] @ (0.2126, 0.7152, 0.0722) / 0.9
    np.testing.assert_allclose(means.luminance[bright & within], luminance, rtol=0.02)
    np.testing.assert_allclose(means.luminance[~bright & within], luminance / 9.0, rtol=0.03)
    if color:
        np.testing.assert_allclose(means.colors[bright & within].mean(axis=0), pixels[0, 2], rtol=0.02)
    assert np.ptp(seen(octree.without_pieces(), camera).luminance) < 0.5 * luminance


def test_far_textures_are_their_mean():
    """A pixel of many bars sees no single one: its rays' footprints are wider."""
    mesh = painted(quad(0.5), Material("bars", (1.0, 1.0, 1.0), base_texture=Texture("bars", stripes(128))))
    octree = exact(mesh)
    camera = flat(above((8, 8)), 0.3)
    means = supersample_pixels(octree, camera, np.arange(64), 1)
    np.testing.assert_allclose(means.luminance, 0.5, atol=0.06)


def test_cut_outs_are_looked_up_where_the_ray_ends():
    """A card with a disc of leaves 0.2 above a white floor."""
    y, x = (np.mgrid[0:64, 0:64] + 0.5) / 64 - 0.5
    disc = (np.hypot(x, y) < 0.3).astype(np.float32)[..., None]
    card = Material("card", (0.2, 0.2, 0.2), alpha_texture=Texture("disc", disc), alpha_threshold=0.5)
    floor, top = quad(0.3).parts[0], quad(0.5).parts[0]
    parts = (floor, replace(top, materials=np.ones(2, np.int32), first_triangle=2))
    octree = exact(TriangleMesh(parts, (WHITE, card)))
    camera = flat(above((120, 120)), 0.3)
    means = seen(octree, camera)
    radius = np.hypot(*picture_points(camera)) * 0.3 / 0.8
    inside, outside = radius < 0.28, radius > 0.32
    np.testing.assert_allclose(means.luminance[inside], 0.2, atol=0.01)
    np.testing.assert_allclose(means.luminance[outside], 1.0, atol=0.01)


def test_partial_opacity_is_the_share_of_rays():
    glass = Material("glass", (1.0, 1.0, 1.0), alpha=0.3)
    octree = exact(painted(quad(0.5), glass))
    means = seen(octree, flat(above(), 0.2), 8)
    assert means.coverage.mean() == pytest.approx(0.3, abs=0.01) and means.coverage.std() < 0.1


def test_light_above_white_is_added_to_colours_alone():
    mesh = quad(0.5)
    octree = exact(mesh, even(3.0))
    means = seen(octree, flat(above(), 0.2))
    np.testing.assert_allclose(means.luminance, 1.0, rtol=1e-4)
    np.testing.assert_allclose(means.colors, 3.0, rtol=5e-3)
    dark = replace(octree, bright_nodes=None, bright_colors=None)  # as if texels alone were above white
    np.testing.assert_array_equal(seen(dark, flat(above(), 0.2)).colors, means.colors)
    clamped = drain(supersample(octree, flat(above(), 0.2), 1, finer=64.0))
    np.testing.assert_allclose(clamped.colors, 1.0, rtol=1e-4)


def test_leaves_of_many_pieces_stay_boxes(monkeypatch):
    rng = np.random.default_rng(4)
    bush = 0.5 + rng.uniform(-0.004, 0.004, (60, 3, 3))
    mesh = TriangleMesh.from_arrays(np.concatenate([bush, quad(0.2).parts[0].corners_world]), (WHITE,))
    octree = exact(mesh)
    first = octree.first_child[octree.child_mask == 0]
    assert 0 < np.count_nonzero(first == NO_PIECES) < 10
    lengths = np.diff(np.flatnonzero(np.append(True, octree.pieces.triangle & LAST)))
    assert lengths.max() <= collect_pieces.MOST_PIECES
    camera = Camera.look_at(np.array([0.5, 0.5, 0.9]), np.array([0.5, 0.5001, 0.5]), size_px=(9, 9))
    assert seen(octree, camera).luminance.reshape(9, 9)[4, 4] == pytest.approx(1.0), "the box"
    monkeypatch.setattr(collect_pieces, "MOST_PIECES", 0)
    assert len(exact(mesh).pieces.triangle) == 0


def test_pieces_depend_on_no_order_and_no_division():
    corners = soup(120, seed=5)
    mesh, turned = (TriangleMesh.from_arrays(each, (WHITE,)) for each in (corners, corners[::-1]))
    octree, other = exact(mesh, two_lights_shade(mesh)), exact(turned, two_lights_shade(turned))
    parts = exact(mesh, two_lights_shade(mesh), block_fragments=300)
    assert octree_hash(octree) == octree_hash(parts)
    np.testing.assert_array_equal(octree.first_child, other.first_child)
    for leaf in np.flatnonzero(octree.child_mask == 0)[::37]:
        found = [{tuple(one.pieces.corners[row]) for row in pieces_of_leaf(one, leaf)} for one in (octree, other)]
        assert found[0] == found[1] and found[0]


def pieces_of_leaf(octree, leaf):
    first = int(octree.first_child[leaf])
    end = first + int(np.argmax(octree.pieces.triangle[first:] & LAST > 0)) + 1
    return octree.pieces.triangle[first:end] & TRIANGLE


@kernel
def _pack(values, packed):
    for i in range(len(values)):
        packed[i] = collect_pieces.packed_light(values[i, 0], values[i, 1], values[i, 2])


def test_packed_light_keeps_nine_bits():
    rng = np.random.default_rng(0)
    values = rng.uniform(0.0, 1.0, (2000, 3)) ** 3 * 10.0 ** rng.uniform(-3, 4, (2000, 1))
    values[:6] = [(0, 0, 0), (-1, np.nan, 0), (0.99999, 0, 0), (65408, 0, 1), (1e9, 0, 0), (1, 1, 1)]
    packed = np.empty(len(values), np.uint32)
    _pack(values, packed)
    expected = np.minimum(np.nan_to_num(np.maximum(values, 0.0)), 65408.0)
    error = np.abs(unpacked_light(packed) - expected).max(axis=1)
    assert (error <= expected.max(axis=1) / 511 + 2.0**-25).all()


@pytest.fixture
def textured():
    alpha = Texture("alpha", np.eye(8, dtype=np.float32)[..., None])
    material = Material("m", (1.0, 1.0, 1.0), base_texture=Texture("bars", stripes(16)), alpha_texture=alpha)
    return exact(painted(quad(0.5), material), color=True)


def test_files_keep_pieces(textured, tmp_path):
    path = tmp_path / "o.safetensors"
    save_octree(textured, path)
    loaded = load_octree(path)
    assert octree_hash(loaded) == octree_hash(textured)
    for own, other in zip(seen(textured, above(), 3), seen(loaded, above(), 3), strict=True):
        np.testing.assert_array_equal(own, other)


def test_pieces_of_another_version_open_as_boxes(textured, tmp_path, monkeypatch):
    path = tmp_path / "o.safetensors"
    monkeypatch.setattr("patchnet.patchnet_addon.octree.file.PIECES_VERSION", PIECES_VERSION + 1)
    save_octree(textured, path)
    monkeypatch.undo()
    loaded = load_octree(path)
    assert loaded.pieces is None
    np.testing.assert_array_equal(seen(loaded, above()).colors, seen(textured.without_pieces(), above()).colors)


def changed_textures(pieces, **values):
    return pieces._replace(textures=pieces.textures._replace(**values))


@pytest.mark.parametrize(
    "change",
    [
        lambda p: p._replace(light=p.light[1:].copy()),
        lambda p: p._replace(corners=p.corners[:1].copy()),
        lambda p: p._replace(uvs=p.uvs.astype(np.float64)),
        lambda p: p._replace(triangle=p.triangle + np.uint32(9)),
        lambda p: p._replace(triangle=p.triangle & TRIANGLE),
        lambda p: p._replace(uvs=p.uvs + np.float32(1.0)),
        lambda p: changed_textures(p, texels=p.textures.texels[:-1].copy()),
        lambda p: changed_textures(p, chains=p.textures.chains[:0].copy()),
        lambda p: changed_textures(p, levels=p.textures.levels - 1),
    ],
)
def test_inconsistent_pieces_are_refused(textured, tmp_path, change):
    path = tmp_path / "bad.safetensors"
    save_octree(replace(textured, pieces=change(textured.pieces)), path)
    with pytest.raises(OctreeFileError, match=r"bad\.safetensors is inconsistent: its pieces do not fit its leaves"):
        load_octree(path)


def test_octrees_without_a_surface_have_no_pieces():
    octree = random_octree(1)
    assert octree.pieces is None and len(octree.exact_nodes.pieces) == 0
