# SPDX-License-Identifier: GPL-3.0-or-later
"""Luminance by direction: sides of nodes and parents against references, files."""

from dataclasses import replace

import numpy as np
import pytest

from patchnet.patchnet_addon.cells.scales import LUMINANCE_SCALE
from patchnet.patchnet_addon.directional import level_sides
from patchnet.patchnet_addon.directional.leaf_sides import LeafSides
from patchnet.patchnet_addon.directional.level_sides import Level, LevelNodes, _Faces, _faces
from patchnet.patchnet_addon.octree.accumulate import LeafAccumulator
from patchnet.patchnet_addon.octree.file import load_octree, octree_hash, save_octree
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.voxelize import LeafDetail
from patchnet.patchnet_addon.runtime.errors import OctreeFileError
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.chroma import REC709
from patchnet.patchnet_addon.surface.mesh import Fragments, Shading, TriangleMesh
from patchnet.patchnet_addon.surface.sides import LIT_BACK, LIT_BOTH, LIT_FRONT
from patchnet.patchnet_addon.tracing.camera import ORTHOGRAPHIC, Camera
from patchnet.patchnet_addon.tracing.render import first_hits, seen_above_white, seen_color, seen_luminance
from patchnet.patchnet_addon.tracing.supersample import supersample, supersample_pixels
from patchnet.tests.references.sides import composed_reference, leaf_reference, seen_reference

from .mesh_samples import even, octree_of, square
from .test_color import GRID, color_shade, gray_shade, soup

DOWN, UP = -1, 1
WITH_SIDES = LeafDetail(sides=True)


def quad(z: float, half: float, pointing: int) -> np.ndarray:
    """Two triangles (2, 3, 3) of a square across z whose normal points up or down."""
    return square(z, -half, half)[:, ::pointing]


def plate(layers: list[tuple[float, float, int, float]], lit: int = LIT_FRONT) -> tuple[TriangleMesh, object]:
    """Squares of (z, half side, UP or DOWN, luminance), and their shade."""
    mesh = TriangleMesh.from_arrays(np.concatenate([quad(*layer[:3]) for layer in layers]))
    plain = even(np.repeat([layer[3] for layer in layers], 2))

    def shade(batch, fragments):
        return plain(batch, fragments)._replace(lit=np.full(len(batch), lit, np.int8))

    return mesh, shade


def lit_by_side(tones: list[list[float]]) -> object:
    """Shade of triangles with luminance of front and back (T, 2)."""

    def shade(batch, fragments):
        lights = np.array(tones, np.float32)[fragments.triangle, :, None]
        lit = np.full(len(batch), LIT_BOTH, np.int8)
        return Shading(lights[:, 0, 0], np.ones(len(fragments), np.float32), sides=lights, lit=lit)

    return shade


def along_z(looking: float, pixels: int) -> Camera:
    """Camera of `pixels` a side that looks up or down at the origin."""
    axis = np.array([0.0, 0.0, looking])
    return Camera(
        np.array([0.03, 0.04, -4.0 * looking]), np.array([looking, 0.0, 0.0]), np.array([0.0, -1.0, 0.0]), axis,
        0.5, 0.5, pixels, pixels, kind=ORTHOGRAPHIC,
    )  # fmt: skip


def seen_along_z(octree, looking: float, pixels: int) -> np.ndarray:
    """Luminance of one ray in each of `pixels` a side."""
    return first_hits(octree, along_z(looking, pixels)).luminance


@pytest.mark.parametrize(("depth", "pixels"), [(10, 2), (10, 4), (10, 16), (10, 256), (7, 16), (7, 128)])
def test_a_white_cloth_hides_the_black_table_from_above_alone(depth, pixels):
    """A cloth 7 mm above a table of 2 m, at every level that has both in one voxel; leaves keep 5 % of the table."""
    layers = [(0.507, 1.0, UP, 1.0), (0.5, 1.0, UP, 0.0), (0.46, 1.0, DOWN, 0.1)]
    mesh, shade = plate(layers)
    octree = octree_of(mesh, shade, Grid((-1.3, -1.3, -1.3), 2.6, depth), exposure=1.0, detail=WITH_SIDES)
    np.testing.assert_allclose(seen_along_z(octree, DOWN, pixels), 1.0, atol=0.03 if depth == 10 else 0.06)
    np.testing.assert_allclose(seen_along_z(octree, UP, pixels), 0.1, atol=0.02)
    one = octree_of(mesh, shade, Grid((-1.3, -1.3, -1.3), 2.6, 10), exposure=1.0)
    if pixels < 64:
        assert seen_along_z(one, DOWN, pixels).mean() < 0.7, "one mean lets the table shine through"


@pytest.mark.parametrize("layers", [0.1, 1.5, 4.0])
@pytest.mark.parametrize("lit", [LIT_FRONT, LIT_BACK])
def test_sides_of_leaves_are_those_of_the_plain_sum(lit, layers):
    """Where there is more than one layer, what lies in front counts more; backs face the other way."""
    rng = np.random.default_rng(8)
    count, size = 4000, 1.0 / 64
    keys, triangle = rng.integers(0, 64, count).astype(np.uint64), np.arange(count, dtype=np.int32)
    ends = np.sort(rng.integers(0, 16, (count, 3, 2)), axis=2)
    boxes = ((ends[..., 0] | ends[..., 1] << 4) << np.array([0, 8, 16])).sum(axis=1).astype(np.uint32)
    area, light = rng.uniform(0, layers * 1.5e-5, count), rng.random(count).astype(np.float32)
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    fragments = Fragments(keys, triangle, np.zeros((count, 2), np.float32), area, boxes=boxes)
    leaves = LeafAccumulator(size, sides=True)
    leaves.add(fragments, Shading(light, np.ones(count), lit=np.full(count, lit, np.int8)), normals)
    found = leaves.take(6)
    sides = found.sides
    for row, leaf in enumerate(sides.leaf):
        here = keys == found.keys[leaf]
        wanted_light, wanted_area = leaf_reference(area[here], lit * normals[here], ends[here], light[here], size)
        np.testing.assert_allclose(sides.light[row], wanted_light, rtol=1e-4)
        np.testing.assert_allclose(sides.share[row] / 65535, np.minimum(wanted_area / size**2, 1.0), atol=5e-5)
    assert len(sides.leaf) == 64


def test_a_plate_that_is_lit_on_its_back_shows_that_there():
    """Normals that point inwards: what is baked on the back of a triangle is seen from there, not through it."""
    mesh, shade = plate([(0.1, 1.0, DOWN, 0.8), (0.09, 1.0, UP, 0.2)], LIT_BACK)
    grid = Grid((-1.0, -1.0, -1.0), 2.0, 4)
    octree = octree_of(mesh, shade, grid, exposure=1.0, detail=WITH_SIDES)
    for looking, light in ((DOWN, 0.8), (UP, 0.2)):
        np.testing.assert_allclose(seen_along_z(octree, looking, 16), light, atol=0.01)


@pytest.mark.parametrize("pixels", [4, 64])
@pytest.mark.parametrize("tilt", [0.0, 0.3, 0.7])
def test_a_tilted_sheet_shows_each_side_in_its_own_light(tilt, pixels):
    """Its back faces along other axes than its front as seen from one side: none of it shines through."""
    corners = quad(0.0, 1.0, UP)
    corners[..., 2] += tilt * corners[..., 0]
    mesh = TriangleMesh.from_arrays(corners)
    grid, shade = Grid((-1.3, -1.3, -1.3), 2.6, 7), lit_by_side([[0.9, 0.2]] * 2)
    octree = octree_of(mesh, shade, grid, exposure=1.0, detail=WITH_SIDES)
    for looking, light in ((DOWN, 0.9), (UP, 0.2)):
        np.testing.assert_allclose(seen_along_z(octree, looking, pixels), light, atol=0.015)


def test_the_dark_inside_of_a_thin_open_box_is_hidden_but_for_who_looks_into_it():
    """Both sides of its walls lie in one voxel; it is open at the bottom."""
    low, high = (-0.5, -0.5, 0.0), (0.5, 0.5, 0.012)
    walls = [quad(high[2], 0.5, UP)]
    for axis in (0, 1):
        for at in (low[axis], high[axis]):
            a, b = low[1 - axis], high[1 - axis]
            corners = np.insert(np.array([[a, 0.0], [b, 0.0], [b, high[2]], [a, high[2]]]), axis, at, axis=1)
            corners = corners if (at > 0) != bool(axis) else corners[::-1]
            walls.append(corners[[[0, 1, 2], [0, 2, 3]]])
    mesh = TriangleMesh.from_arrays(np.concatenate(walls))
    grid, shade = Grid((-1.3, -1.3, -1.3), 2.6, 6), lit_by_side([[0.8, 0.0]] * 10)
    octree = octree_of(mesh, shade, grid, exposure=1.0, detail=WITH_SIDES)
    for way in ((0, 0, -1), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0.7, 0.1, -0.7), (-0.2, 0.9, -0.3), (0, 0, 1)):
        forward = np.array(way) / np.linalg.norm(way)
        right = np.cross(forward, [0.31, 0.2, 0.93])
        right /= np.linalg.norm(right)
        place = -4.0 * forward + np.array([0.01, 0.02, 0.006])
        camera = Camera(place, right, np.cross(right, forward), forward, 0.7, 0.7, 128, 128, kind=ORTHOGRAPHIC)
        hits = first_hits(octree, camera)
        wrong = np.abs(hits.luminance[hits.hit] - (0.0 if way[2] > 0 else 0.8)) > 0.02
        assert wrong.mean() < (0.05 if way[2] > 0 else 0.005), way  # from below the walls' edges are bright


def test_a_sheet_has_its_sides_before_the_underside_of_the_ground_below_it(monkeypatch):
    """Where bytes do not suffice for all: who looks up from the slope sees the sheet's back, and nobody the slope's."""
    monkeypatch.setattr(level_sides, "_FREE", 0)
    corners = np.concatenate([quad(-0.5, 1.2, UP), quad(0.3, 0.5, UP)])
    corners[:2, :, 2] += 0.4 * corners[:2, :, 0]
    shade = lit_by_side([[0.9, 0.2]] * 2 + [[0.5, 0.3]] * 2)
    mesh, grid = TriangleMesh.from_arrays(corners), Grid((-1.3, -1.3, -1.3), 2.6, 8)
    octree = octree_of(mesh, shade, grid, exposure=1.0, detail=WITH_SIDES)
    camera = replace(along_z(UP, 128), position_world=np.array([0.0, 0.0, -0.2]))
    np.testing.assert_allclose(first_hits(octree, camera).luminance, 0.3, atol=0.01)
    assert len(octree.side_nodes) < 0.19 * octree.node_count


def test_light_above_white_belongs_to_the_bright_side():
    mesh, shade = plate([(0.1, 1.0, UP, 5.0), (0.09, 1.0, DOWN, 0.1)])
    octree = octree_of(mesh, shade, Grid((-1.0, -1.0, -1.0), 2.0, 4), exposure=1.0, detail=WITH_SIDES)
    for looking, least, most in ((DOWN, 2.0, 5.0), (UP, 0.1, 0.3)):
        camera = along_z(looking, 8)
        light = supersample_pixels(octree, camera, np.arange(camera.pixel_count), 2).colors
        assert least <= light.min() and light.max() <= most
        hits = first_hits(octree, camera)
        shown = seen_color(octree, hits.node, hits.direction) + seen_above_white(octree, hits)
        np.testing.assert_allclose(light, shown, atol=1e-5)


@pytest.fixture(scope="module", params=["gray", "colour"])
def octree(request):
    shade = gray_shade if request.param == "gray" else color_shade
    return octree_of(soup(np.arange(150), []), shade, GRID, exposure=1.5, detail=LeafDetail(boxes=True, sides=True))


def test_nodes_show_what_the_plain_twin_says(octree):
    rng = np.random.default_rng(2)
    nodes = np.concatenate([octree.side_nodes.astype(np.int64), rng.integers(0, octree.node_count, 500)])
    assert len(octree.side_nodes) > 100
    directions = rng.normal(size=(len(nodes), 3))
    directions = (directions / np.linalg.norm(directions, axis=1, keepdims=True)).astype(np.float32)
    directions[:3] = np.eye(3)
    wanted = seen_reference(octree, nodes, directions)
    np.testing.assert_allclose(seen_color(octree, nodes, directions), wanted, atol=2e-6)
    np.testing.assert_allclose(seen_luminance(octree, nodes, directions), wanted @ REC709, atol=2e-6)
    assert np.abs(wanted @ REC709 - octree.luminance_float(nodes)).max() > 0.2
    assert not seen_luminance(octree, np.full(2, -1), directions[:2]).any()


def test_pictures_are_means_of_what_nodes_show(octree):
    """Super-sampled pictures are those of single rays, in luminance and colour."""
    camera = Camera.look_at(np.array([2.0, 2.3, 1.7]), np.zeros(3), size_px=(40, 30))
    hits = first_hits(octree, camera)
    np.testing.assert_allclose(drain(supersample(octree, camera, 1)).luminance, hits.luminance, atol=1e-6)
    colors = seen_color(octree, hits.node, hits.direction) + seen_above_white(octree, hits)
    means = supersample_pixels(octree, camera, np.arange(camera.pixel_count), 1)
    np.testing.assert_allclose(means.colors, colors, atol=2e-6)


@pytest.mark.parametrize("cuts, block_fragments", [([40, 90], 10**9), ([75], 100)])
def test_batches_and_passes_change_no_bits(octree, cuts, block_fragments):
    shade = gray_shade if octree.chroma is None else color_shade
    mesh = soup(np.arange(150), cuts)
    detail = LeafDetail(boxes=True, sides=True)
    found = octree_of(mesh, shade, GRID, exposure=1.5, detail=detail, block_fragments=block_fragments)
    assert octree_hash(found) == octree_hash(octree)


def test_faces_show_the_children_in_front():
    rng = np.random.default_rng(5)
    masks = rng.integers(1, 256, 40).astype(np.uint8)
    count = int(np.unpackbits(masks).sum())
    bright, share = rng.integers(0, 65536, (2, count, 6)).astype(np.uint16)
    none = np.empty((0, 6), np.float32)
    below = _Faces(bright, share, np.maximum(share[:, ::2], share[:, 1::2]), np.empty((count, 6, 0), np.uint8))
    nodes = np.ones(len(masks), np.float32), np.zeros((len(masks), 3), np.int8), np.zeros(len(masks), np.uint16)
    sides = LeafSides(np.empty(0, np.int64), none, none.astype(np.uint16), np.empty((0, 6, 0), np.uint8))
    level = Level(LevelNodes(masks, *nodes, np.empty((len(masks), 0), np.uint8)), 1.0, sides)
    found = _faces(level, np.empty(0, np.int64), slice(0, len(masks)), below, 1.0)
    light, cover = below.light / LUMINANCE_SCALE, below.cover / LUMINANCE_SCALE
    first = 0
    for node, mask in enumerate(masks.tolist()):
        there = [mask >> octant & 1 for octant in range(8)]
        children = [first + sum(there[:octant]) if there[octant] else -1 for octant in range(8)]
        first += sum(there)
        for face in range(6):
            *wanted, is_back = composed_reference(children, face, light, share, cover)
            both = found.light[node, face] / LUMINANCE_SCALE, found.share[node, face] / LUMINANCE_SCALE
            np.testing.assert_allclose(both, wanted, atol=5e-5, err_msg="shares are rounded up to two units")
            assert found.share[node, face] % 2 == is_back


def test_files_keep_sides_and_refuse_what_contradicts_itself(octree, tmp_path):
    path = tmp_path / "o.safetensors"
    save_octree(octree, path)
    loaded = load_octree(path)
    np.testing.assert_array_equal(loaded.side_nodes, octree.side_nodes)
    np.testing.assert_array_equal(loaded.light.sides.light, octree.side_light)
    shorter, turned = octree.side_share[1:], octree.side_nodes[::-1]
    for change in ({"side_light": None}, {"side_share": shorter}, {"side_nodes": turned}):
        save_octree(replace(octree, **change), path)
        with pytest.raises(OctreeFileError, match=r"its sides .* incomplete|differ in length|sides .* is out of order"):
            load_octree(path)
