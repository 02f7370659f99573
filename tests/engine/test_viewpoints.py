# SPDX-License-Identifier: GPL-3.0-or-later
"""Automatic cameras: in free space, inside rooms, around objects, on what is worth seeing; deterministic."""

from collections.abc import Iterator

import numpy as np
import pytest

from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.patchnet_addon.runtime.errors import SceneError, SettingError
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.runtime.threads import limit_threads
from patchnet.patchnet_addon.surface.mesh import TriangleMesh
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.patchnet_addon.tracing.render import first_hits
from patchnet.patchnet_addon.tracing.viewpoints import encloses, free_positions, viewpoints
from patchnet.tests.engine.mesh_samples import box, even, octree_of, square


def triangle_octree(triangles: np.ndarray, depth: int = 7, luminance: float | np.ndarray = 0.5) -> Octree:
    return octree_of(TriangleMesh.from_arrays(triangles), even(luminance), depth, exposure=1.0)


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """Thousands of pictures of 32 x 24: threads for each cost more than they save, beside other work 20 times so."""
    with limit_threads(1):
        yield


@pytest.fixture(scope="module")
def house() -> Octree:
    """A room of 6 x 4 x 3 in walls of 0.5, and a pillar in it."""
    shell = box((-0.5, -0.5, -0.5), (6.5, 4.5, 3.5))
    return triangle_octree(
        np.concatenate([shell, box((0, 0, 0), (6, 4, 3), inwards=True), box((2.8, 1.8, 0), (3.2, 2.2, 3))])
    )


def test_rooms_enclose_their_free_space_and_objects_do_not(house: Octree) -> None:
    roofless = box((0, 0, 0), (6, 4, 3), inwards=True)[:-2]
    solid, garden = box((0, 0, 0), (1, 1, 1)), box((-6, -6, -0.2), (6, 6, 0))
    assert encloses(house) and encloses(triangle_octree(box((0, 0, 0), (6, 4, 3), inwards=True)))
    assert not encloses(triangle_octree(solid)) and not encloses(
        triangle_octree(np.concatenate([garden, solid * [1, 1, 3]]))
    )
    assert not encloses(triangle_octree(np.concatenate([garden, roofless * 0.3]))), "a court in a garden"


def test_without_light_cameras_stand_in_a_room_with_a_window() -> None:
    """Not in the hollow wall beside it, which is larger, and sees itself all around, too."""
    rooms = [box((0, 0, 0), (6, 4, 3), inwards=True)[:-2], box((6.3, -6, 0), (8.2, 14, 3), inwards=True)]
    octree = triangle_octree(np.concatenate(rooms), luminance=0.0)
    cameras = drain(viewpoints(octree, 3, (32, 24), lit=False))
    assert len(cameras) == 3 and all(0 < camera.position_world[0] < 6 for camera in cameras)
    assert any(position[0] > 6.3 for position in free_positions(octree))


def test_cameras_stand_in_the_room(house: Octree) -> None:
    cameras = drain(viewpoints(house, 4, (32, 24)))
    assert [camera.name for camera in cameras] == ["View 1", "View 2", "View 3", "View 4"]
    for camera in cameras:
        x, y, z = camera.position_world
        assert 0 < x < 6, "inside, neither in a wall nor outside"
        assert 0 < y < 4
        assert 0 < z < 3
        assert not (2.8 < x < 3.2 and 1.8 < y < 2.2), "not in the pillar"
        assert camera.up[2] > 0.9
        assert camera.right[2] == pytest.approx(0.0, abs=1e-9), "the horizon is level"
        assert first_hits(house, camera).hit.all()
        assert (camera.width_px, camera.height_px) == (32, 24)


def test_placing_is_deterministic_and_varied(house: Octree) -> None:
    first, second = (drain(viewpoints(house, 3, (32, 24))) for _ in range(2))
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one.position_world, other.position_world)
        np.testing.assert_array_equal(one.forward, other.forward)
    views = {tuple(np.round([*camera.position_world, *camera.forward], 6)) for camera in first}
    assert len(views) == 3


def test_what_cannot_be_placed_is_said(house: Octree) -> None:
    with pytest.raises(SettingError, match="cameras"):
        drain(viewpoints(house, 0, (32, 24)))
    black = triangle_octree(box((0, 0, 0), (6, 4, 3), inwards=True), luminance=0.0)
    with pytest.raises(SceneError, match="auto"):
        drain(viewpoints(black, 2, (32, 24)))


def test_hollow_walls_are_no_place_for_a_camera() -> None:
    """Inside a dark shell, coarse voxels shine with the light on its outer side, which is only a voxel away."""
    hollow = np.concatenate([box((0, 0, 0), (4, 4, 4)), box((0.06, 0.06, 0.06), (3.94, 3.94, 3.94), inwards=True)])
    room = box((6, 0, 0), (10, 4, 4), inwards=True)
    octree = triangle_octree(np.concatenate([hollow, room]), depth=8, luminance=np.repeat([0.5, 0.0, 0.5], 12))
    cameras = drain(viewpoints(octree, 3, (32, 24)))
    assert cameras and all(camera.position_world[0] > 6 for camera in cameras)


PLANE = square(0, -2, 2)
UPRIGHT = PLANE @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], float)
CARDS = np.concatenate([PLANE * 0.1 @ turn + place for turn, place in zip(
    np.linalg.qr(np.random.default_rng(0).normal(size=(40, 3, 3)))[0],
    np.random.default_rng(1).normal(size=(40, 1, 1, 3)), strict=True)])  # fmt: skip


@pytest.mark.parametrize(
    ("triangles", "least"),
    [
        (PLANE, 0.3),
        (UPRIGHT, 0.3),
        (CARDS, 0.1),
        (box((99, 50, 3), (99.001, 50.001, 3.001)), 0.2),
        (box((0, 0, 0), (30, 0.02, 0.02)), 0.01),
        (box((0, 0, 0), (4, 4, 0.1), inwards=True), 0.1),
        (np.concatenate([PLANE, *(box((x, -1.5, 0), (x + 0.05, 1.5, 0.1)) for x in (-1.5, 0, 1))]), 0.3),
    ],
    ids=["plane", "upright plane", "cards", "tiny box", "rod", "backs alone", "floor plan"],
)
def test_an_object_is_seen_as_a_whole(triangles: np.ndarray, least: float) -> None:
    octree = triangle_octree(triangles, luminance=0.0)
    for camera in drain(viewpoints(octree, 2, (48, 36), lit=False)):
        hit = first_hits(octree, camera).hit.reshape(36, 48)
        assert hit.mean() > least and camera.up[2] > 0.5
        assert not (hit[0].any() or hit[-1].any() or hit[:, 0].any() or hit[:, -1].any()), "within the picture"


@pytest.mark.parametrize(
    "size", [(0.0, 0.0, 2.6), (20.0, 0.0, 0.0), (3.0, 4.0, 0.0)], ids=["shaft", "corridor", "room"]
)
def test_an_empty_room_is_seen_from_inside(size: tuple[float, float, float]) -> None:
    high = np.array([2.0, 2.0, 2.6]) + size
    octree = triangle_octree(box((0, 0, 0), high, inwards=True), luminance=0.0)
    (camera,) = drain(viewpoints(octree, 1, (48, 36), lit=False))
    assert (camera.position_world > 0).all() and (camera.position_world < high).all()
    assert first_hits(octree, camera).hit.all()


def seen_within(octree: Octree, camera: Camera, low: tuple[float, ...], high: tuple[float, ...]) -> float:
    """Share of the pixels that show surface in a box."""
    hits = first_hits(octree, camera.with_size(96, 72))
    places = camera.position_world + hits.t_world[hits.hit, None] * hits.direction[hits.hit]
    return float(((places > low) & (places < high)).all(axis=1).sum() / len(hits.hit))


def test_furniture_is_preferred_to_bare_walls() -> None:
    parts = [box((0, 0, 0), (9, 6, 3), inwards=True), box((2.5, 2.3, 0.7), (6.5, 3.7, 0.76))]
    for x in (2.8, 3.8, 4.8, 5.8):
        for y in (1.7, 4.3):
            parts += [
                box((x, y - 0.2, 0.45), (x + 0.4, y + 0.2, 0.5)),
                box((x + 0.2, y, 0), (x + 0.25, y + 0.05, 0.45)),
            ]
    octree = triangle_octree(np.concatenate(parts), luminance=0.0)
    cameras = drain(viewpoints(octree, 3, (48, 36), lit=False))
    assert len(cameras) == 3
    assert min(seen_within(octree, camera, (2.4, 1.4, 0.1), (6.6, 4.6, 0.85)) for camera in cameras) > 0.04


def ball(radius: float, sides: int = 24) -> np.ndarray:
    """Triangles (t, 3, 3) of a sphere whose faces look outwards."""
    up, around = np.meshgrid(np.linspace(-np.pi / 2, np.pi / 2, sides), np.linspace(0, 2 * np.pi, sides))
    points = radius * np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], axis=2)
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    return np.stack([a, b, c, a, c, d], axis=2).reshape(-1, 3, 3)


@pytest.mark.parametrize("around", [[], [ball(60)]], ids=["open", "in a sky"])
def test_a_small_thing_on_wide_ground_is_found(around: list[np.ndarray]) -> None:
    """A closed sky shows its backs to its inside, and is no object."""
    thing = [box((10, -9, 0), (14, -6, 3)), box((11, -8, 3), (13, -7, 5))]
    octree = triangle_octree(np.concatenate([PLANE * 15, *thing, *around]), depth=8, luminance=0.0)
    cameras = drain(viewpoints(octree, 2, (48, 36), lit=False))
    assert max(seen_within(octree, camera, (9.5, -9.5, 0.5), (14.5, -5.5, 5.5)) for camera in cameras) > 0.02
