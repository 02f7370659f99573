# SPDX-License-Identifier: GPL-3.0-or-later
"""Connected sheets of meshes: consistent fronts, open boundaries, volumes, solid angles."""

from collections import Counter, defaultdict

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from patchnet.patchnet_addon.light.sheets import add_solid_angles, add_volumes, sheets_of
from patchnet.patchnet_addon.surface.sides import faces_of
from patchnet.tests.references.surfels import face_reference

from .mesh_samples import QUADS, box

CUBE = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float32)


def halves(quads: list[tuple[int, ...]]) -> np.ndarray:
    return np.array([corners for a, b, c, d in quads for corners in ((a, b, c), (a, c, d))], np.int32)


def reference(vertices: np.ndarray, triangles: np.ndarray) -> tuple[list[set[int]], list[bool]]:
    """Sheets as components of the graph of triangles that share an edge, and which are open."""
    places: dict[tuple[float, ...], int] = {}
    welded = [[places.setdefault(tuple(vertices[v].tolist()), len(places)) for v in row] for row in triangles]
    at: dict[frozenset[int], list[tuple[int, int]]] = defaultdict(list)
    left = [t for t, row in enumerate(welded) if len(set(row)) == 3]
    for t in left:
        for i in range(3):
            at[frozenset((welded[t][i], welded[t][(i + 1) % 3]))].append((t, welded[t][i]))
    joined = [users for users in at.values() if len(users) == 2 and users[0][1] != users[1][1]]
    ends = np.array([[t for t, _ in users] for users in joined]).T
    pairs = coo_array((np.ones(len(joined)), ends), shape=(len(triangles),) * 2)
    component = connected_components(pairs, directed=False)[1]
    sheets = [{t for t in left if component[t] == one} for one in np.unique(component[left])]
    inside = Counter(t for users in joined for t, _ in users)  # edges of a triangle that lie within its sheet
    return sheets, [any(inside[t] < 3 for t in sheet) for sheet in sheets]


@pytest.mark.parametrize("seed", range(8))
def test_as_components_of_a_graph(seed: int) -> None:
    """Grids with holes, turned and doubled triangles, and triangles without area, on vertices of their own."""
    rng = np.random.default_rng(seed)
    side = 7
    low = np.add.outer(np.arange(side - 1) * side, np.arange(side - 1)).ravel()
    grid = np.concatenate([np.stack([low, low + 1, low + side], 1), np.stack([low + 1, low + side + 1, low + side], 1)])
    grid = grid[rng.random(len(grid)) > 0.15]
    turned = rng.random(len(grid)) < 0.15
    grid[turned] = grid[turned][:, ::-1]
    extra = np.concatenate([grid[:3], [[0, 0, 1]], rng.integers(0, side * side, (6, 3))])
    triangles = rng.permutation(np.concatenate([grid, extra]))
    corners = np.stack([np.arange(side * side) // side, np.arange(side * side) % side, np.zeros(side * side)], 1)
    soup = corners[triangles.ravel()].astype(np.float32)  # each triangle with vertices of its own
    number, is_open = sheets_of(soup, np.arange(len(soup), dtype=np.int32).reshape(-1, 3))
    sheets, boundary = reference(corners, triangles)
    assert len(is_open) == len(sheets) > 1
    assert (number == -1).sum() == len(triangles) - sum(map(len, sheets))
    for members, wanted in zip(sheets, boundary, strict=True):
        (mine,) = set(number[sorted(members)].tolist())
        assert (number == mine).sum() == len(members) and is_open[mine] == wanted


def test_a_closed_cube_has_one_sheet_without_a_boundary_also_inside_out() -> None:
    for triangles in (halves(QUADS), halves(QUADS)[:, ::-1]):
        number, is_open = sheets_of(CUBE, np.ascontiguousarray(triangles))
        assert not number.any() and is_open.tolist() == [False]


def test_a_cube_with_a_wall_within_falls_into_open_sheets() -> None:
    """At the edges of the wall three triangles meet: who stands on either side of it sees a sheet of its own."""
    vertices = np.concatenate([CUBE, CUBE * [0, 1, 1] + [0.5, 0, 0]]).astype(np.float32)  # 8 .. 11 in the middle
    near = [(0, 1, 3, 2), (0, 8, 9, 1), (2, 3, 11, 10), (0, 2, 10, 8), (1, 9, 11, 3)]
    far = [(4, 6, 7, 5), (8, 4, 5, 9), (10, 11, 7, 6), (8, 10, 6, 4), (9, 5, 7, 11)]
    number, is_open = sheets_of(vertices, halves([*near, *far, (8, 9, 11, 10)]))
    assert is_open.tolist() == [True] * 3
    assert [len(set(part.tolist())) for part in (number[:10], number[10:20], number[20:])] == [1, 1, 1]


def test_faces_are_those_that_directions_face_most() -> None:
    """The back faces the opposite one, also where axes are equal."""
    axes = np.array([1.0, -1.0, 0.0, 0.5])
    directions = np.concatenate([np.stack(np.meshgrid(axes, axes, axes), axis=-1).reshape(-1, 3), np.eye(3)])
    directions = np.concatenate([directions, np.random.default_rng(0).normal(size=(50, 3))])
    directions = directions[directions.any(axis=1)]
    faces = faces_of(directions)
    assert faces.dtype == np.uint8 and faces_of(np.concatenate([np.eye(3), -np.eye(3)])).tolist() == [0, 2, 4, 1, 3, 5]
    assert faces.tolist() == [face_reference(direction) for direction in directions]
    np.testing.assert_array_equal(faces_of(-directions), faces ^ 1)


def test_volumes_are_those_of_boxes() -> None:
    """Two boxes, the second turned inside out, and a triangle of no sheet; any origin gives the same."""
    corners = np.concatenate([box((0, 0, 0), (1, 2, 3)), box((4, 5, 6), (5, 5.5, 7), inwards=True), np.ones((1, 3, 3))])
    corners[-1] = np.random.default_rng(0).random((3, 3))
    sheet = np.repeat([0, 1, -1], [12, 12, 1]).astype(np.int32)
    for origin in (np.zeros(3), np.array([4.5, 5.25, 6.5]), np.array([-30.0, 7.0, 11.0])):
        volumes = np.zeros(2)
        for part in (slice(0, 7), slice(7, 25)):  # sums go on over batches
            add_volumes(corners[part], sheet[part], origin, volumes)
        np.testing.assert_allclose(volumes, [6.0 * 6.0, -6.0 * 0.5], rtol=1e-9)  # six times the volume


def test_solid_angles_tell_inside_from_outside() -> None:
    """Eyes inside, outside, and near an edge on either side of it; the other sheet is flipped, one eye not asked."""
    corners = np.concatenate([box((0, 0, 0), (1, 1, 1)), box((0, 0, 0), (1, 1, 1), inwards=True)])
    sheet = np.repeat([0, 1], 12).astype(np.int32)
    eyes = np.array([(0.5, 0.5, 0.5), (2.0, 0.3, 0.4), (1e-6, 1e-6, 0.4), (-1e-6, -1e-6, 0.4)])
    within = np.ones((2, 4), bool)
    within[1, 2] = False
    angles = np.zeros((2, 4))
    add_solid_angles(corners, sheet, eyes, within, angles)
    inside = np.array([1.0, 0.0, 1.0, 0.0])
    # Angles of the triangles at an edge are differences of numbers a million times as large.
    np.testing.assert_allclose(angles / (4.0 * np.pi), [inside, -inside * within[1]], atol=1e-6)


def test_solid_angle_of_a_triangle_is_that_of_sampled_directions() -> None:
    rng = np.random.default_rng(3)
    corners, eye = rng.normal(size=(1, 3, 3)), np.array([0.1, 0.2, -0.3])
    angles = np.zeros((1, 1))
    add_solid_angles(corners, np.zeros(1, np.int32), eye[None], np.ones((1, 1), bool), angles)
    directions = rng.normal(size=(400_000, 3))
    weights = np.linalg.solve((corners[0] - eye).T, directions.T)  # all positive: the ray meets the triangle
    share = (weights > 0.0).all(axis=0).mean()
    assert share > 0.01
    assert abs(angles[0, 0]) / (4.0 * np.pi) == pytest.approx(share, abs=5.0 * np.sqrt(share / 400_000))
