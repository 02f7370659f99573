# SPDX-License-Identifier: GPL-3.0-or-later
"""Training samples: random views of random patches, with coverage and luminance by 4096 rays (methods 7.16 to 7.19).

Samples are drawn and stored by voxel: the encoder, nearly all of the cost of training, then runs once for the eight
corners of a voxel for all of its views.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...patchnet_addon.codes.brick import MIDDLE, check_nodes, empty_brick, fill_brick
from ...patchnet_addon.codes.patch_rays import VIEWPORT_PX, PatchRay, Viewport, render_patch
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.octree.sides import NO_SIDES, NodeLight
from ...patchnet_addon.runtime.bounds import DEFAULT_LOOKAHEAD
from ...patchnet_addon.runtime.errors import PatchNetError
from ...patchnet_addon.runtime.kernels import device, kernel
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.runtime.threads import run_parts
from ..settings import VIEWS
from .voxel_choice import choose_voxels, held_out_voxels, usable_nodes

VIEW_FIELDS = 12  # entry 3, direction 3, up 3, ratio, coverage, luminance
UNIT, SIGNED = 65535.0, 32767.0
_ATTEMPTS = 400  # per voxel and view; a voxel that is hidden from nearly everywhere is left out
_CHUNK = 32768
COVERAGE_SCALE = 4096.0


@dataclass(frozen=True)
class SampleSettings:
    """Settings of drawing samples.

    views: random views per voxel. min_level: coarsest level used. held_out: share of spatial blocks kept for
    validation (methods 7.21). lookahead: levels between a voxel and the cells that are seen, 1 to 3.
    """

    views: int = VIEWS
    min_level: int = 5
    held_out: float = 0.05
    seed: int = 0
    lookahead: int = DEFAULT_LOOKAHEAD


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
    """Draw at least `count` samples (views) of an octree.

    Raises PatchNetError if no voxel of the octree has look-ahead below `settings.min_level`, or for more than 2^31
    nodes.
    """
    check_nodes(octree.node_count)
    random = np.random.default_rng(settings.seed)
    nodes = usable_nodes(octree, settings.min_level, settings.lookahead)
    groups = -(-count // settings.views)
    found: list[Samples] = []
    done, number = 0, 0
    barren = 0
    while done < groups:
        voxels = choose_voxels(octree, nodes, min(_CHUNK, groups - done + 64), random)
        outside, inside = held_out_voxels(octree, voxels, settings.held_out, settings.seed)
        voxels, is_held_out = voxels[outside | inside], inside[outside | inside]
        views, good = _views(octree, voxels, settings, number)
        number += len(voxels)
        barren = 0 if good.any() else barren + 1
        if barren > 20:
            raise PatchNetError("No voxel of this octree is visible from outside: give a deeper octree")
        found.append(Samples(voxels[good], is_held_out[good], views[good]))
        done += int(good.sum())
        yield Progress(min(done, groups) * settings.views, count, label)
    return Samples(
        np.concatenate([part.voxel for part in found])[:groups],
        np.concatenate([part.held_out for part in found])[:groups],
        np.concatenate([part.views for part in found])[:groups],
    )


def _views(octree: Octree, voxels: np.ndarray, settings: SampleSettings, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Views (n, R, 12) uint16 of voxels (n, 4), and whether (n,) all R were found."""
    views = np.zeros((len(voxels), settings.views, VIEW_FIELDS), np.uint16)
    good = np.zeros(len(voxels), np.bool_)
    start = np.uint64((settings.seed * 0x9E3779B97F4A7C15 + number) & 0xFFFFFFFFFFFFFFFF)
    scene = octree.boxed_nodes, NodeLight(octree.luminance, NO_SIDES)
    run_parts(_draw_views, len(voxels), scene, voxels.astype(np.int32), start, settings.lookahead, views, good)
    return views, good


@device
def _mix(state):
    """Splitmix64 finaliser: a random word from a counter, the same on any number of cores."""
    state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return state ^ (state >> np.uint64(31))


@device
def begin_random(state, start, number):
    """Initialize the random state (1,) uint64 of item `number` for the seed `start`, uint64."""
    state[0] = _mix(_mix(start + np.uint64(number)))


@device
def uniform(state):
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


@device
def _draw_line(state, origin, direction, up):
    """Random direction, roll, and a line through the disc of radius sqrt(3)/2 around the voxel's centre."""
    height, turn = 2.0 * uniform(state) - 1.0, 2.0 * np.pi * uniform(state)
    flat = np.sqrt(max(0.0, 1.0 - height * height))
    direction[0], direction[1], direction[2] = flat * np.cos(turn), flat * np.sin(turn), height
    roll = 2.0 * np.pi * uniform(state)
    a = (-np.sin(turn), np.cos(turn), 0.0)  # a and b span the plane across the direction
    b = (-height * np.cos(turn), -height * np.sin(turn), flat)
    radius, angle = np.sqrt(0.75 * uniform(state)), 2.0 * np.pi * uniform(state)
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


@device
def draw_voxel_views(state, nodes, light, root, voxel, lookahead, views):
    """Draw random views (R, 12) uint16 of a voxel (level, x, y, z) below `root`; returns whether all R were found.

    A view whose centre ray meets a neighbour first is rejected (methods 7.17). state: (1,) uint64 of the random
    numbers, which is advanced.
    """
    brick = empty_brick(lookahead)
    viewport = Viewport(np.empty((9, 3), np.float64), np.empty(VIEWPORT_PX, np.uint64))
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
        ratio = np.uint16(np.rint((0.5 + 0.5 * uniform(state)) * UNIT))
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
def _draw_views(first, last, scene, voxels, start, lookahead, views, good):
    nodes, light = scene
    state = np.empty(1, np.uint64)
    for group in range(first, last):
        begin_random(state, start, group)
        good[group] = draw_voxel_views(state, nodes, light, 0, voxels[group], lookahead, views[group])
