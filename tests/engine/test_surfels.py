# SPDX-License-Identifier: GPL-3.0-or-later
"""Choice of surfels against a dictionary of all fragments; sides, sheets, and chances in proportion to area."""

from dataclasses import replace

import numpy as np
import pytest

from patchnet.patchnet_addon.light.seen_cells import SeenCells, all_cells, cells_of
from patchnet.patchnet_addon.light.surfels import (
    COARSE,
    MOST_SHEETS,
    SURFEL,
    choose_surfels,
    eyes_of,
)
from patchnet.patchnet_addon.lod.fit import leaf_keys_of
from patchnet.patchnet_addon.octree import blocks
from patchnet.patchnet_addon.octree import voxelize as voxelizer
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.voxelize import ClippedSurface
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.runtime.threads import limit_threads
from patchnet.patchnet_addon.surface.sides import BACK, FRONT
from patchnet.patchnet_addon.tracing.camera import ORTHOGRAPHIC, Camera
from patchnet.tests.references.clip import each_fragment
from patchnet.tests.references.surfels import face_reference, surfels_reference

from .light_samples import (
    FLAT_GRID,
    NO_EYES,
    THINNED,
    partly_seen,
    random_layout,
    random_surface,
    sheet_surface,
    surfels_of,
)
from .mesh_samples import box, even, square

GRID = Grid((0.0, 0.0, 0.0), 1.0, 5)
EYES = np.array([(0.5, 0.4, 0.45, 1.0), (2.0, -1.0, 0.7, 1.0), (0.6, 0.0, 0.8, 0.0)])


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("eyes", [NO_EYES, EYES], ids=["all", "eyes"])
@pytest.mark.parametrize("is_color", [False, True], ids=["light", "color"])
def test_as_a_loop_over_all_fragments(seed: int, eyes: np.ndarray, is_color: bool) -> None:
    """The same winners; areas are rounded up to their units."""
    source, sheets = random_surface(seed)
    clipped = ClippedSurface(source, GRID, random_layout(seed))
    seen = partly_seen(clipped, THINNED, seed)
    surfels = drain(choose_surfels(clipped, THINNED, sheets, seen, eyes, is_color=is_color))
    expected = surfels_reference(clipped, THINNED, sheets, seen, eyes, is_color)
    rows = sorted(expected.items(), key=lambda row: (*row[0][:2], row[1].rank, row[1].id))
    assert len(surfels) == len(rows) > 150 and (surfels["pixels"] > 0.0).mean() > 0.2
    for name, column in {"cell": 0, "face": 1, "sheet": 2}.items():
        assert surfels[name].tolist() == [place[column] for place, _ in rows]
    for name in ("id", "leaf", "triangle", "side"):
        assert surfels[name].tolist() == [getattr(one, name) for _, one in rows]
    np.testing.assert_allclose(surfels["share"], [one.share for _, one in rows], rtol=1e-6)
    np.testing.assert_array_equal(surfels["pixels"], np.array([one.pixels for _, one in rows], np.float32))


def test_places_are_those_of_the_fragments() -> None:
    source, sheets = random_surface(4)
    clipped = ClippedSurface(source, GRID)
    pieces = {}
    for _, fragments, f, key, number in each_fragment(clipped):
        pieces[key, number] = (fragments.area_world[f], *fragments.barycentric[f])
    surfels = surfels_of(source, sheets, grid=GRID)
    found = [pieces[int(one["leaf"]) >> 5, int(one["triangle"])] for one in surfels]
    columns = np.stack([surfels[name] for name in ("area", "one", "two")], axis=1)
    np.testing.assert_array_equal(columns, np.array(found, np.float32))


@pytest.mark.parametrize("way", ["one batch", "many batches", "passes", "cores", "threads"])
def test_the_choice_does_not_depend_on_the_division_of_the_work(way: str, monkeypatch: pytest.MonkeyPatch) -> None:
    cuts = {"one batch": (), "many batches": tuple(range(3, 60, 3))}.get(way, (17, 40))
    (first, sheets), (source, _) = random_surface(2), random_surface(2, cuts)
    seen = partly_seen(ClippedSurface(first, GRID), THINNED, 2)
    expected = drain(choose_surfels(ClippedSurface(first, GRID), THINNED, sheets, seen, EYES))
    if way == "cores":
        monkeypatch.setattr(voxelizer, "usable_cores", lambda: 3)
        monkeypatch.setattr(blocks, "MIN_SHARE", 10)
    clipped = ClippedSurface(source, GRID, block_fragments=500 if way == "passes" else 1 << 24)
    assert (len(clipped.passes) > 5) == (way == "passes") and (len(clipped.passes[0]) == 3) == (way == "cores")
    with limit_threads(1 if way == "threads" else None):
        found = drain(choose_surfels(clipped, THINNED, sheets, seen, EYES))
    for name in SURFEL.names:
        np.testing.assert_array_equal(found[name], expected[name], name)


def test_more_surfels_than_the_first_table_has_room_for() -> None:
    """Tables grow while a part is entered: a second square in the same leaves adds its area, and no surfels."""
    grid, squares = replace(FLAT_GRID, depth=9), (square(0.3), np.concatenate([square(0.3), square(0.3)]))
    once, twice = (surfels_of(*sheet_surface(corners), grid=grid) for corners in squares)
    assert len(once) == len(twice) > 1 << 16
    for surfels, area in ((once, 0.64), (twice, 1.28)):
        fine = surfels["pixels"] > 0.0
        sums = surfels["share"][fine].sum(), surfels["share"][~fine].sum()
        np.testing.assert_allclose(sums, 2.0 * area, rtol=1e-9)  # of both sides


@pytest.mark.parametrize(
    ("lit", "eyes", "fine", "coarse"),
    [
        (1, NO_EYES, {FRONT}, {FRONT}),
        (-1, NO_EYES, {BACK}, {BACK}),
        (0, NO_EYES, {FRONT, BACK}, {FRONT, BACK}),
        (0, [(0.5, 0.5, 2.0, 1.0)], {FRONT}, {FRONT, BACK}),
        (0, [(0.5, 0.5, 0.1, 1.0)], {BACK}, {FRONT, BACK}),
        (0, [(0.5, 0.5, 0.1, 1.0), (0.0, 0.6, 0.8, 0.0)], {FRONT, BACK}, {FRONT, BACK}),
        (1, [(0.5, 0.5, 0.1, 1.0)], set(), {FRONT}),
    ],
)
def test_sides(lit: int, eyes: list | np.ndarray, fine: set[int], coarse: set[int]) -> None:
    """A square that faces up, among eyes above and below it: position and 1, or direction and 0."""
    surfels = surfels_of(*sheet_surface(square(0.3), 0, lit), eyes=np.array(eyes).reshape(-1, 4))
    is_fine = surfels["pixels"] > 0.0
    assert set(surfels["side"][is_fine].tolist()) == fine and set(surfels["side"][~is_fine].tolist()) == coarse
    np.testing.assert_array_equal(surfels["face"], np.where(surfels["side"] == FRONT, 4, 5))
    for kind, sides in ((is_fine, fine), (~is_fine, coarse)):
        assert surfels["share"][kind].sum() == pytest.approx(0.64 * len(sides), rel=1e-9)


@pytest.mark.parametrize(("wanted", "pixels"), [(4, 16.0), (5, 16.0), (2, 16.0), (1, 4.0), (0, 1.0)])
@pytest.mark.parametrize("stop", range(7))
def test_surface_far_off_shows_pixels(stop: int, wanted: int, pixels: float) -> None:
    """Rays may end in voxels of any level, and their pixels need cells above the coarse ones, which are of level 2."""
    if stop < wanted:
        return
    source, sheets = sheet_surface(square(0.3))
    clipped = ClippedSurface(source, FLAT_GRID)
    keys = np.unique(drain(leaf_keys_of(clipped, even()))[6] >> np.uint64(3 * (6 - stop)))
    seen = SeenCells(cells_of(keys, stop), np.full(len(keys), wanted), np.full(len(keys), 16.0, np.float32))
    surfels = drain(choose_surfels(clipped, even(), sheets, seen, np.array([(0.5, 0.5, 2.0, 1.0)])))
    level, shown = (surfels["cell"] & np.uint64(31)).astype(int), surfels["pixels"]
    assert set(level.tolist()) == {2, max(wanted, 2)}
    assert set(shown[level == 2].tolist()) == ({0.0} if wanted > 2 else {0.0, pixels})
    np.testing.assert_array_equal(shown > 0.0, (level == max(wanted, 2)) & (surfels["side"] == FRONT))
    assert surfels["share"][shown > 0.0].sum() == pytest.approx(0.64, rel=1e-9)
    assert surfels["share"][level == 2].sum() == pytest.approx(2 * 0.64, rel=1e-9)


@pytest.mark.parametrize("depth", [1, 2, 3])
def test_flat_octrees(depth: int) -> None:
    """Light cells are above the leaves and below the root, which is the coarse one of all; they show pixels."""
    surfels = surfels_of(*sheet_surface(square(0.3)), grid=replace(FLAT_GRID, depth=depth))
    level, shown = (surfels["cell"] & np.uint64(31)).astype(int), surfels["pixels"] > 0.0
    assert set(level.tolist()) == {0, depth - 1} and set(level[shown].tolist()) == {depth - 1}
    for kind in (shown, level == 0):
        assert surfels["share"][kind].sum() == pytest.approx(2 * 0.64, rel=1e-9)


@pytest.mark.parametrize("size", [1e-25, 1e-9, 1.0, 1e12])
def test_surfels_of_any_size(size: float) -> None:
    """Ranks of areas that single precision cannot hold are none, and not those of an empty row."""
    surfels = surfels_of(*sheet_surface(size * square(0.3)), grid=Grid((0.0, 0.0, 0.0), size, 6))
    assert len(surfels) == 2 * (26 * 26 + 4 * 4) and len(np.unique(surfels["cell"])) == 26 * 26 + 4 * 4
    assert surfels["id"].all() and set(surfels["triangle"].tolist()) == {0, 1} and (surfels["one"] > 0.0).all()


def test_eyes_of_cameras() -> None:
    camera = Camera.look_at(np.array([1.0, 2.0, 3.0]), np.array([1.0, 5.0, 3.0]))
    eyes = eyes_of([camera, replace(camera, kind=ORTHOGRAPHIC)])
    np.testing.assert_allclose(eyes, [(1, 2, 3, 1), (0, -1, 0, 0)], atol=1e-12)
    assert eyes_of([]).shape == (0, 4)


def test_faces_of_a_box_are_apart() -> None:
    corners = box((0.2, 0.2, 0.2), (0.7, 0.7, 0.7))
    surfels = surfels_of(*sheet_surface(corners, lit=1))
    edges = corners[:, 1:] - corners[:, :1]
    faces = [face_reference(normal) for normal in np.cross(edges[:, 0], edges[:, 1])]
    assert surfels["face"].tolist() == [faces[triangle] for triangle in surfels["triangle"]]
    assert set(faces) == set(range(6))


def test_cells_have_few_sheets() -> None:
    """Twice as many squares above each other in each cell as sheets may have surfels."""
    count = 2 * MOST_SHEETS
    corners = np.concatenate([square(0.3 + 0.001 * i) for i in range(count)])
    surfels = surfels_of(*sheet_surface(corners, np.repeat(np.arange(count), 2), 1))
    places = np.unique(surfels[["cell", "sheet"]])
    assert (np.unique(places["cell"], return_counts=True)[1] == MOST_SHEETS).all()
    kept = np.unique(places["sheet"], return_counts=True)[1]
    assert len(kept) == count, "no sheet is left out everywhere"


def test_chances_are_in_proportion_to_area_times_opacity() -> None:
    """In each of 900 light cells a triangle, and one of half its opacity and six times its area: three of four win."""
    side, places = 1.0 / (1 << FLAT_GRID.depth), 2 * np.arange(1, 31)
    low = np.stack(np.meshgrid(places, places, [14]), axis=-1).reshape(-1, 1, 3) * side
    large = np.array([(0.05, 0.05, 0.2), (0.95, 0.05, 0.2), (0.05, 0.95, 0.2)]) * side
    small = large * [1.0 / 6.0, 1.0, 2.0] + [0.01 * side, 0.0, 0.0]
    corners = np.concatenate([low + small, low + large])
    surfels = surfels_of(*sheet_surface(corners, lit=1), even(1.0, np.repeat([1.0, 0.5], 900)))
    fine = surfels[surfels["pixels"] > 0.0]
    assert len(fine) == 900
    # Four standard deviations of 900 draws; the seed is the hash.
    assert (fine["triangle"] >= 900).mean() == pytest.approx(0.75, abs=4.0 * np.sqrt(0.75 * 0.25 / 900))


def test_cameras_that_see_more_leave_other_cells_as_they_are() -> None:
    source, sheets = random_surface(5)
    clipped = ClippedSurface(source, GRID)
    seen = partly_seen(clipped, even(), 5)
    first = SeenCells(*(column[: len(column) // 2] for column in seen))
    before, after = (drain(choose_surfels(clipped, even(), sheets, cells, EYES)) for cells in (first, seen))
    coarse = [surfels[surfels["pixels"] == 0.0] for surfels in (before, after)]
    np.testing.assert_array_equal(coarse[0]["id"], coarse[1]["id"])
    common = np.isin(before["id"], after["id"])
    assert common.mean() > 0.8 and len(after) > len(before)


def test_each_cell_has_one_surfel_of_each_face_and_sheet() -> None:
    """Two squares, whose coarse cells are those of 16 x 16 leaves, and the fine ones those of 2 x 2."""
    corners = np.concatenate([square(0.3), square(0.301)])
    surfels = surfels_of(*sheet_surface(corners, [0, 0, 1, 1]))
    level = (surfels["cell"] & np.uint64(31)).astype(int)
    up = FLAT_GRID.depth - level
    assert set(up.tolist()) == {1, COARSE}
    leaves = surfels["leaf"] >> np.uint64(5)
    np.testing.assert_array_equal(surfels["cell"] >> np.uint64(5), leaves >> (3 * up).astype(np.uint64))
    cells = {1: 26 * 26, COARSE: 4 * 4}  # from 0.1 to 0.9
    for step, count in cells.items():
        mine = surfels[up == step][["cell", "face", "sheet"]]
        assert len(mine) == len(np.unique(mine)) == 4 * count


def test_a_surface_of_gaps_has_no_surfels() -> None:
    source, sheets = random_surface(0)
    clipped = ClippedSurface(source, GRID)
    seen = all_cells(drain(leaf_keys_of(clipped, even())))
    assert len(drain(choose_surfels(clipped, even(1.0, 0.0), sheets, seen, NO_EYES))) == 0
