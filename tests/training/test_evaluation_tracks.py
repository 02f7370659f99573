# SPDX-License-Identifier: GPL-3.0-or-later
"""Camera tracks: reproducible, in free space, smooth, with look-ahead."""

from itertools import pairwise

import numpy as np
import pytest

from patchnet.patchnet_addon.lod.fit import lookahead_share
from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.mesh import TriangleMesh
from patchnet.patchnet_addon.surface.shading import two_lights_shade
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.patchnet_addon.tracing.render import first_hits
from patchnet.tests.engine.mesh_samples import box, octree_of
from patchnet.training.benchmarks.shells import octree_of_shells
from patchnet.training.evaluation.explorations import MAX_STEP, MAX_TURN
from patchnet.training.evaluation.poses import Surroundings, step_of, turn_of
from patchnet.training.evaluation.tracks import FAR, TrackSettings, camera_track

FRAMES = 60
CLEARANCE = 4  # finest voxels


def yard() -> Octree:
    """A floor with walls on three sides, pillars and a table, in the way of the demo's courtyard."""
    parts = [
        box((0, 0, -0.2), (12, 12, 0)),
        box((0, 0, 0), (0.3, 12, 4)),
        box((0, 11.7, 0), (12, 12, 5)),
        box((11.7, 0, 0), (12, 12, 3)),
        box((5, 5, 1), (7, 7, 1.1)),
        *(box((x, 9, 0), (x + 0.4, 9.4, 3)) for x in (2, 5, 8)),
    ]
    mesh = TriangleMesh.from_arrays(np.concatenate(parts))
    return octree_of(mesh, two_lights_shade(mesh), 8)


@pytest.fixture(scope="module", params=["shells", "yard"])
def octree(request: pytest.FixtureRequest) -> Octree:
    return octree_of_shells(300_000) if request.param == "shells" else yard()


@pytest.fixture(scope="module")
def track(octree: Octree) -> list[Camera]:
    return drain(camera_track(octree, TrackSettings(FRAMES)))


def halves(track: list[Camera]) -> tuple[list[Camera], list[Camera]]:
    return track[: FRAMES // 2], track[FRAMES // 2 :]


def test_same_seed_same_track(octree: Octree, track: list[Camera]) -> None:
    again = drain(camera_track(octree, TrackSettings(FRAMES)))
    other = drain(camera_track(octree, TrackSettings(FRAMES, seed=1)))
    for one, next_one in zip(track, again, strict=True):
        np.testing.assert_array_equal(one.position_world, next_one.position_world)
        np.testing.assert_array_equal(one.forward, next_one.forward)
    assert not np.array_equal(track[-1].position_world, other[-1].position_world)


def test_sizes_and_halves(octree: Octree, track: list[Camera]) -> None:
    assert len(track) == FRAMES and {(each.width_px, each.height_px) for each in track} == {(130, 130)}
    near, far = ({each.name.split()[0] for each in half} for half in halves(track))
    assert near == {"Approach"} and far == {"Exploration"}
    centre = octree.grid.to_world(np.full(3, 0.5))
    distances = [np.linalg.norm(each.position_world - centre) / octree.grid.side_world for each in track]
    assert FAR - 1 < distances[0] < FAR + 1 and max(distances[FRAMES // 2 :]) < FAR


def test_clearance_of_all_leaves(octree: Octree, track: list[Camera]) -> None:
    """Brute force: every leaf against every second frame and two points on the way to the next."""
    leaves = octree.cells(octree.depth).astype(np.float64)
    voxel = octree.grid.voxel_size_world
    low = np.asarray(octree.grid.origin_world) + leaves * voxel
    for one, next_one in list(pairwise(track))[::2]:
        way = next_one.position_world - one.position_world if one.name == next_one.name else np.zeros(3)
        for share in (0.0, 1 / 3, 2 / 3):
            point = one.position_world + share * way
            apart = np.maximum(np.maximum(low - point, point - (low + voxel)), 0.0)
            assert np.sqrt((apart**2).sum(axis=1)).min() >= CLEARANCE * voxel * (1 - 1e-9)


def test_look_ahead(octree: Octree, track: list[Camera]) -> None:
    share, seen = Surroundings(octree, (130, 130), 2).share(track), [first_hits(octree, camera) for camera in track]
    hits = np.array([hits.hit.sum() for hits in seen])
    ahead = sum(octree.look_ahead(2)[hits.node[hits.hit]].sum() for hits in seen)
    assert share == pytest.approx(ahead / hits.sum()) and share >= 0.95 and hits.all()
    assert 0.1 < hits.sum() / sum(camera.pixel_count for camera in track) < 1.0
    shares = [lookahead_share(octree.nodes, octree.grid, camera) for camera in track]
    assert min(shares) - 1e-9 <= share <= max(shares) and np.mean(shares) >= 0.95
    assert min(hits.t_world.min() for hits in seen) > CLEARANCE * octree.grid.voxel_size_world


def test_frames_near_each_other_look_alike(octree: Octree, track: list[Camera]) -> None:
    approach, exploration = halves(track)
    assert all(0 < step_of(*pair) <= MAX_STEP * octree.grid.side_world for pair in pairwise(exploration))
    steps = [step_of(*pair) for pair in pairwise(approach)]
    assert all(later < earlier for earlier, later in pairwise(steps))  # the same factor at each frame
    assert all(turn_of(*pair) <= MAX_TURN for half in (approach, exploration) for pair in pairwise(half))
