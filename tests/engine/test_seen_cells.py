# SPDX-License-Identifier: GPL-3.0-or-later
"""Leaves that cameras see, and the levels of their light cells, against rays through a list of all nodes."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from patchnet.patchnet_addon.light import seen_cells as module
from patchnet.patchnet_addon.light.seen_cells import SeenCells, _joined, all_cells, cells_of, seen_cells
from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.tracing.camera import ORTHOGRAPHIC, Camera
from patchnet.tests.references.surfels import _cell_around, seen_cells_reference

from .octree_samples import octree_from_leaves, random_octree, with_boxes


def leaf_keys(octree: Octree) -> dict[int, np.ndarray]:
    found = {}
    for level in range(octree.depth + 1):
        here = slice(*octree.level_start[level : level + 2])
        keys = octree.keys(level)[octree.child_mask[here] == 0]
        if len(keys):
            found[level] = keys
    return found


def cameras(width: int = 20, height: int = 15) -> list[Camera]:
    """Inside, far off, and with parallel rays."""
    inside = Camera.look_at(np.array([0.5, 0.4, 0.45]), np.array([0.9, 0.2, 0.3]), size_px=(14, 10))
    far = Camera.look_at(np.array([2.0, -1.0, 1.0]), np.full(3, 0.5), size_px=(width, height))
    return [inside, far, replace(far, kind=ORTHOGRAPHIC, half_x=0.6, half_y=0.45)]


@pytest.mark.parametrize("kind", ["small", "large", "track"])
@pytest.mark.parametrize("lookahead", [1, 2])
def test_each_ray_ends_in_a_cell(kind: str, lookahead: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of stills, and of six cameras, which are a track."""
    octree = with_boxes(random_octree(3, depth=6, count=900, adaptive=True))
    views = cameras()
    if kind == "track":  # as many rays as pixels of stills, where most light cells are known
        views = [camera.with_size(2 * camera.width_px, 2 * camera.height_px) for camera in views] * 2
    monkeypatch.setattr(module, "SMALL_PX", 0 if kind == "large" else module.SMALL_PX)
    seen = drain(seen_cells(octree.nodes, octree.grid, views, lookahead=lookahead))
    expected = seen_cells_reference(octree, views, lookahead, small=kind == "small")
    assert seen.cells.tolist() == sorted(expected) and len(expected) > 90
    assert seen.level.tolist() == [expected[cell][0] for cell in sorted(expected)]
    np.testing.assert_allclose(seen.pixels, [expected[cell][1] for cell in sorted(expected)], rtol=1e-5)
    assert len({cell & 31 for cell in expected}) > 1 and len(set(seen.level.tolist())) > 1


def test_frames_that_see_what_those_before_show_have_a_quarter_of_the_rays(monkeypatch: pytest.MonkeyPatch) -> None:
    octree, calls, trace = random_octree(3, depth=6, count=900), [], module.ray_stops

    def counted(*arguments: Any) -> Any:
        calls.append(arguments)
        return trace(*arguments)

    monkeypatch.setattr(module, "ray_stops", counted)
    drain(seen_cells(octree.nodes, octree.grid, cameras() * 3))
    assert len(calls) == 3 * (1 + 4) + 6 * 1


def _shell() -> Octree:
    """Leaves around a cube."""
    side = np.arange(8)
    cells = np.stack(np.meshgrid(side, side, side), axis=-1).reshape(-1, 3)
    shell = cells[((cells == 0) | (cells == 7)).any(axis=1)].tolist()
    return octree_from_leaves({(3, tuple(cell)): (1.0, 0.5, (0.0, 0.0, 1.0)) for cell in shell}, 3)


def test_pixels_of_a_view_that_is_full_are_all_its_pixels() -> None:
    """From within a closed shell of leaves, each light cell once; many rows of pixels are several parts."""
    octree = _shell()
    keys = octree.keys(3)
    camera = Camera.look_at(np.array([0.5, 0.45, 0.55]), np.array([1.0, 0.7, 0.6]), size_px=(30, 150))
    seen = drain(seen_cells(octree.nodes, octree.grid, [camera]))
    around = {_cell_around(int(cell), int(level)): pixels for cell, level, pixels in zip(*seen, strict=True)}
    assert sum(around.values()) == pytest.approx(30 * 150, rel=1e-5)
    assert np.isin(seen.cells, cells_of(keys, 3)).all() and (np.diff(seen.cells.astype(np.int64)) > 0).all()


def test_cameras_of_a_long_track_share_the_rays_of_a_picture() -> None:
    """Each has rays in half of its rows, and all its pixels; from within a closed shell."""
    octree = _shell()
    camera = Camera.look_at(np.array([0.5, 0.45, 0.55]), np.array([1.0, 0.7, 0.6]), size_px=(32, 128))
    seen = drain(seen_cells(octree.nodes, octree.grid, [camera] * 50))
    around = {_cell_around(int(cell), int(level)): pixels for cell, level, pixels in zip(*seen, strict=True)}
    assert sum(around.values()) == pytest.approx(50 * 32 * 128, rel=1e-5)
    alone = drain(seen_cells(octree.nodes, octree.grid, [camera] * 5))
    assert np.isin(alone.cells, seen.cells).all()


def test_no_camera_and_no_hit_see_nothing() -> None:
    octree = random_octree(0)
    away = Camera.look_at(np.array([3.0, 3.0, 3.0]), np.array([9.0, 9.0, 9.0]), size_px=(4, 3))
    for views in ([], [away]):
        seen = drain(seen_cells(octree.nodes, octree.grid, views))
        assert [len(column) for column in seen] == [0, 0, 0] and seen.cells.dtype == np.uint64


def test_joined_cells_have_the_finest_level_and_all_pixels() -> None:
    parts = [
        SeenCells(np.array([9, 5, 9], np.uint64), np.array([3, 4, 6]), np.array([1.0, 2.0, 4.0], np.float32)),
        SeenCells(np.array([0, 5], np.uint64), np.array([7, 2]), np.array([8.0, 16.0], np.float32)),
    ]
    cells, level, pixels = _joined(parts)
    assert (cells.tolist(), level.tolist(), pixels.tolist()) == ([0, 5, 9], [7, 4, 6], [8.0, 18.0, 5.0])


def test_without_cameras_all_leaves_are_seen_at_their_level() -> None:
    keys = leaf_keys(random_octree(1, adaptive=True))
    seen = all_cells(keys)
    assert (np.diff(seen.cells.astype(np.int64)) > 0).all() and (seen.pixels == 1.0).all()
    np.testing.assert_array_equal(seen.level, (seen.cells & np.uint64(31)).astype(int))
    assert set(seen.cells.tolist()) == {int(key) << 5 | level for level, part in keys.items() for key in part}
