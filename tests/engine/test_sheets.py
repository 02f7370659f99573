# SPDX-License-Identifier: GPL-3.0-or-later
"""Connected sheets of meshes: consistent fronts, open boundaries, lit sides by measured light."""

from collections import defaultdict

import numpy as np
import pytest

from patchnet.patchnet_addon.lightmap.sheet_sides import lit_sides, sheets_of

CUBE = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float32)
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def halves(quads: list[tuple[int, ...]]) -> np.ndarray:
    return np.array([corners for a, b, c, d in quads for corners in ((a, b, c), (a, c, d))], np.int32)


def reference(vertices: np.ndarray, triangles: np.ndarray) -> tuple[list[set[int]], list[bool]]:
    """Sheets by a search from triangle to triangle, edge by edge, and which are open."""
    places: dict[tuple[float, ...], int] = {}
    welded = [[places.setdefault(tuple(vertices[v].tolist()), len(places)) for v in row] for row in triangles]
    at: dict[frozenset[int], list[tuple[int, int]]] = defaultdict(list)
    left = [t for t, row in enumerate(welded) if len(set(row)) == 3]
    for t in left:
        for i in range(3):
            at[frozenset((welded[t][i], welded[t][(i + 1) % 3]))].append((t, welded[t][i]))
    sheets, boundary, met = [], [], set()
    for start in left:
        if start in met:
            continue
        sheet, todo, is_open = {start}, [start], False
        while todo:
            t = todo.pop()
            for i in range(3):
                users = at[frozenset((welded[t][i], welded[t][(i + 1) % 3]))]
                if len(users) != 2 or users[0][1] == users[1][1]:
                    is_open = True
                    continue
                (other,) = (u for u, _ in users if u != t)
                if other not in sheet:
                    sheet.add(other)
                    todo.append(other)
        met |= sheet
        sheets.append(sheet)
        boundary.append(is_open)
    return sheets, boundary


@pytest.mark.parametrize("seed", range(8))
def test_as_a_search_finds_them(seed: int) -> None:
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


@pytest.mark.parametrize(
    ("front", "back", "lit"),
    [
        (1.0, 1.0, 0),
        (0.1, 1.0, 0),  # ceiling of a dim room, the sun on its top
        (1.0, 0.021, 0),
        (1.0, 0.019, 1),  # a building's wall, dark inside
        (0.019, 1.0, -1),  # the same, with normals into the building
        (0.0, 1.0, -1),
        (0.0, 1e-4, 1),  # dark on both sides
        (0.0, 0.0, 1),
    ],
)
def test_one_sheet_among_others_in_light(front: float, back: float, lit: int) -> None:
    light = np.array([(1.0, 0.8), (front, back), (1.2, 0.0)])
    assert lit_sides(light, np.array([4.0, 1.0, 4.0])).tolist() == [0, lit, 1]


def test_a_front_as_bright_as_others_is_lit_whatever_falls_on_its_back() -> None:
    light = np.array([(0.01, 1.0), (0.012, 1.0), (0.011, 0.9)])
    assert lit_sides(light, np.ones(3)).tolist() == [0, 0, 0]
    light[1, 0] = 1e-4
    assert lit_sides(light, np.ones(3)).tolist() == [0, -1, 0]
