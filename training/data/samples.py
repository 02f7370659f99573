# SPDX-License-Identifier: GPL-3.0-or-later
"""Training samples: random views of random patches, with coverage and luminance by 4096 rays (methods 7.16 to 7.19).

Samples are drawn and stored by voxel: the encoder, nearly all of the cost of training, then runs once for the eight
corners of a voxel for all of its views.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...patchnet_addon.codes.brick import MIDDLE, empty_brick, fill_brick
from ...patchnet_addon.codes.patch_rays import PatchRay, empty_viewport, render_patch
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.errors import PatchNetError
from ...patchnet_addon.runtime.kernels import array_device, device, kernel
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.runtime.threads import run_parts
from .forest import Forest, concatenate, tree_nodes
from .voxel_choice import SampleSettings, VoxelLists, candidates

VIEW_FIELDS = 12  # entry 3, direction 3, up 3, ratio, coverage, luminance
UNIT, SIGNED = 65535.0, 32767.0
_ATTEMPTS = 400  # per voxel and view; a voxel that is hidden from nearly everywhere is left out
_VOXELS = 1000  # tries per place, before the octree counts as hidden
_CHUNK = 32768
_FILES = 6  # purpose of random numbers, beside the seed
COVERAGE_SCALE = 4096.0


@dataclass(frozen=True, eq=False)
class Samples:
    """G voxels of one octree with R views each.

    voxel: (G, 4) uint16 level, x, y, z. held_out: (G,) bool, for validation only.
    views: (G, R, 12) uint16: entry point (65535 = 1), direction and up (int16, 32767 = 1), ratio (65535 = 1),
    coverage (rays that hit, of 4096), luminance (65535 = 1).
    """

    voxel: np.ndarray
    held_out: np.ndarray
    views: np.ndarray


def draw_samples(
    octree: Octree, count: int, settings: SampleSettings, label: str = "Drawing samples"
) -> Steps[Samples]:
    """Draw at least `count` samples (views) of an octree, on all cores; those of held-out voxels are last.

    Raises PatchNetError if no voxel of the octree has look-ahead below `settings.min_level`, or for more than 2^31
    nodes.
    """
    forest, groups = concatenate([octree]), -(-count // settings.views)
    training, validation = candidates(octree, settings)
    counts = [sum(map(len, voxels)) for voxels in (training, validation)]
    held_out = min(-(-groups * counts[1] // sum(counts)), groups - 1)
    parts = [(training, groups - held_out)] + ([(validation, held_out)] if held_out else [])
    drawn: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for number, (voxels, share) in enumerate(parts):
        lists = VoxelLists.of([voxels], share)
        for first in range(0, share, _CHUNK):
            yield Progress(first + number * parts[0][1], groups, label)
            places = slice(first, min(first + _CHUNK, share))
            drawn.append(draw(forest, lists, settings, (settings.seed, _FILES + number), places, parallel=True))
    _, voxel, views = (np.concatenate(column) for column in zip(*drawn, strict=True))
    return Samples(voxel, np.arange(groups) >= groups - held_out, views)


def draw(
    forest: Forest,
    lists: VoxelLists,
    settings: SampleSettings,
    seeds: Sequence[int],
    places: slice,
    *,
    parallel: bool = False,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Octrees (V,), voxels (V, 4) and views (V, R, 12) at places of a draw, which depend on seeds and place only.

    Octrees of the forest have equal probability. parallel: on all cores. Raises PatchNetError if no voxel is visible.
    """
    count = places.stop - places.start
    tree, voxel = np.empty(count, np.int32), np.empty((count, 4), np.uint16)
    views = np.empty((count, settings.views, VIEW_FIELDS), np.uint16)
    how = np.random.SeedSequence(seeds).generate_state(1, np.uint64)[0], places.start, settings.lookahead
    octrees, where = (forest.nodes, forest.light, forest.root), (lists.voxel, lists.start, lists.below)
    if parallel:
        run_parts(_draw, count, how, octrees, where, tree, voxel, views)
    else:
        _draw(0, count, how, octrees, where, tree, voxel, views)
    if (tree < 0).any():
        raise PatchNetError("No voxel of an octree is visible from outside: give a deeper octree")
    return tree, voxel, views


@device
def _mix(state):
    """Splitmix64 finaliser: a random word from a counter, the same on any number of cores."""
    state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return state ^ (state >> np.uint64(31))


@array_device
def _uniform(state):
    """Next random number of [0, 1); `state` is (1,) uint64."""
    state[0] += np.uint64(0x9E3779B97F4A7C15)
    return np.float64(_mix(state[0]) >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@device
def _enter_box(origin, direction, x, y, z):
    """Distance at which a line enters the unit cube at (x, y, z), 1e30 if it misses; may be negative."""
    enter, leave = -1e30, 1e30
    for axis in range(3):
        low = x if axis == 0 else (y if axis == 1 else z)
        if abs(direction[axis]) < 1e-12:
            if origin[axis] < low or origin[axis] > low + 1.0:
                return 1e30
            continue
        t0 = (low - origin[axis]) / direction[axis]
        t1 = (low + 1.0 - origin[axis]) / direction[axis]
        enter, leave = max(enter, min(t0, t1)), min(leave, max(t0, t1))
    return enter if enter <= leave else 1e30


@array_device
def _draw_line(state, origin, direction, up):
    """Random direction, roll, and a line through the disc of radius sqrt(3)/2 around the voxel's centre."""
    height, turn = 2.0 * _uniform(state) - 1.0, 2.0 * np.pi * _uniform(state)
    flat = np.sqrt(max(0.0, 1.0 - height * height))
    direction[0], direction[1], direction[2] = flat * np.cos(turn), flat * np.sin(turn), height
    roll = 2.0 * np.pi * _uniform(state)
    a = (-np.sin(turn), np.cos(turn), 0.0)  # a and b span the plane across the direction
    b = (-height * np.cos(turn), -height * np.sin(turn), flat)
    radius, angle = np.sqrt(0.75 * _uniform(state)), 2.0 * np.pi * _uniform(state)
    for axis in range(3):
        up[axis] = np.cos(roll) * a[axis] + np.sin(roll) * b[axis]
        origin[axis] = 0.5 + radius * (np.cos(angle) * a[axis] + np.sin(angle) * b[axis])


@device
def _is_first_hit(counts, origin, direction, enter):
    """Return whether no other occupied voxel of the 3x3x3 neighbourhood is entered before the centre one."""
    for block in range(27):
        if counts[block] > 0 and block != MIDDLE:
            x, y, z = block % 3 - 1.0, block // 3 % 3 - 1.0, block // 9 - 1.0
            if _enter_box(origin, direction, x, y, z) < enter:
                return False
    return True


@array_device
def _draw_views(state, nodes, light, root, voxel, lookahead, views):
    """Draw random views (R, 12) uint16 of a voxel (level, x, y, z) below `root`; returns whether all R were found.

    A view whose centre ray meets a neighbour first is rejected (methods 7.17). state: (1,) uint64 of the random
    numbers, which is advanced.
    """
    brick = empty_brick(lookahead)
    viewport = empty_viewport()
    fill_brick(nodes, root, voxel[0], voxel[1:], lookahead, brick)
    origin, direction, up = np.empty(3), np.empty(3), np.empty(3)
    found = 0
    for _ in range(_ATTEMPTS):
        if found == len(views):
            break
        _draw_line(state, origin, direction, up)
        enter = _enter_box(origin, direction, 0.0, 0.0, 0.0)
        if enter > 1e29 or not _is_first_hit(brick.counts, origin, direction, enter):
            continue
        # Rounds before rendering, so that the stored view is exact.
        ratio = np.uint16(np.rint((0.5 + 0.5 * _uniform(state)) * UNIT))
        for axis in range(3):
            entry = min(max(origin[axis] + enter * direction[axis], 0.0), 1.0)
            views[found, axis] = np.uint16(np.rint(entry * UNIT))
            along = np.int16(np.rint(direction[axis] * SIGNED))
            across = np.int16(np.rint(up[axis] * SIGNED))
            views[found, 3 + axis] = np.uint16(along)
            views[found, 6 + axis] = np.uint16(across)
            origin[axis] = views[found, axis] / UNIT
            direction[axis] = along / SIGNED
            up[axis] = across / SIGNED
        ray = PatchRay(origin, direction, up, float(ratio) / UNIT)
        sigma, mean = render_patch(nodes, light, brick, ray, lookahead, viewport)
        views[found, 9] = ratio
        views[found, 10] = np.uint16(np.rint(sigma * COVERAGE_SCALE))
        views[found, 11] = np.uint16(np.rint(mean))
        found += 1
    return found == len(views)


@kernel
def _draw(first, last, how, octrees, lists, tree, voxel, views):
    """Draw places `first` to `last`; a tree of -1 means that no voxel was found."""
    start, offset, lookahead = how
    nodes, light, root = octrees
    candidates, starts, below = lists
    state = np.empty(1, np.uint64)
    for place in range(first, last):
        state[0] = _mix(_mix(start + np.uint64(offset + place)))  # of the place, for the seed
        octree = min(np.int64(_uniform(state) * len(root)), len(root) - 1)
        tree[place] = -1
        for _ in range(_VOXELS):
            chance, level = _uniform(state), 0
            while level < below.shape[1] - 1 and chance >= below[octree, level]:
                level += 1
            count = starts[octree, level + 1] - starts[octree, level]
            if count == 0:
                continue
            here = candidates[starts[octree, level] + min(np.int64(_uniform(state) * count), count - 1)]
            node = here.astype(np.int64)
            if _draw_views(state, tree_nodes(nodes, octree), light, root[octree], node, lookahead, views[place]):
                tree[place] = octree
                voxel[place] = here
                break
