# SPDX-License-Identifier: GPL-3.0-or-later
"""Path of a walk: straight through free space, inside a room rather than around it."""

import numpy as np

from patchnet.commands.benches.walk_path import walk_keys
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.tracing.viewpoints import grown, occupied_cells
from patchnet.tests.engine.test_viewpoints import box, octree_of


def test_the_way_leads_along_a_hall() -> None:
    hall = box((0.0, 0.0, 0.0), (12.0, 3.0, 3.0), inwards=True)
    octree = octree_of(np.concatenate([hall, box((5.0, 0.0, 0.0), (6.0, 1.0, 1.0))]))
    keys = drain(walk_keys(octree, (64, 36)))
    places = np.array([key.position_world for key in keys])
    assert (places > 0.0).all() and (places < [12.0, 3.0, 3.0]).all(), "inside"
    assert np.linalg.norm(places[2] - places[0]) > 6.0 and np.ptp(places[:, 2]) < 1e-9
    np.testing.assert_allclose(places[1], (places[0] + places[2]) / 2)
    steps = places[0] + np.linspace(0, 1, 200)[:, None] * (places[2] - places[0])
    cells = np.floor(octree.grid.to_unit(steps) * 64).astype(int)
    assert not grown(occupied_cells(octree, 6))[tuple(cells.T)].any()
    way = (places[2] - places[0]) / np.linalg.norm(places[2] - places[0])
    for key, turn in zip(keys, (20.0, 0.0, -20.0), strict=True):
        flat = np.array(key.forward)[:2] / np.linalg.norm(np.array(key.forward)[:2])
        angle = np.degrees(np.arctan2(way[0] * flat[1] - way[1] * flat[0], way[:2] @ flat))
        assert abs(angle - turn) < 0.5


def test_a_court_under_the_sky_comes_before_a_longer_hollow_wall() -> None:
    hollow = box((0.0, 4.0, 0.0), (14.0, 6.0, 3.0), inwards=True)
    court = box((0.0, 0.0, 0.0), (8.0, 3.5, 3.0), inwards=True)
    court = court[(court[..., 2] < 2.9).any(axis=1)]  # without its lid
    octree = octree_of(np.concatenate([hollow, court]))
    places = np.array([key.position_world for key in drain(walk_keys(octree, (64, 36)))])
    assert (places[:, 1] < 3.5).all() and np.linalg.norm(places[2] - places[0]) > 1.5
