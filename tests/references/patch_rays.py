# SPDX-License-Identifier: GPL-3.0-or-later
"""Reference of ray-traced patches in plain NumPy: each of 4096 rays against every occupied cube (methods 7.16)."""

from __future__ import annotations

import numpy as np

from patchnet.patchnet_addon.codes.patch_rays import VIEWPORT_PX, PatchRays
from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.patchnet_addon.runtime.bounds import DEFAULT_LOOKAHEAD
from patchnet.tests.references.first_hits import box_interval
from patchnet.tests.references.lookups import box_bounds, brick_nodes
from patchnet.tests.references.sides import luminance_reference


def render_patches_reference(
    octree: Octree, rays: PatchRays, lookahead: int = DEFAULT_LOOKAHEAD
) -> tuple[np.ndarray, np.ndarray]:
    """Reference of `render_patches`: coverage and mean luminance (N,) float64, by the slab test."""
    groups = np.repeat(np.arange(len(rays.level)), np.diff(rays.group_start))
    seen = [_seen(octree, rays, group, ray, lookahead) for ray, group in enumerate(groups)]
    coverage, luminance = np.array(seen, np.float64).reshape(-1, 2).T
    return coverage, luminance


def _seen(octree: Octree, rays: PatchRays, group: int, ray: int, lookahead: int) -> tuple[float, float]:
    """Coverage and mean luminance of one viewport."""
    nodes = brick_nodes(octree, int(rays.level[group]), rays.cell[group], lookahead)
    side = 0.5**lookahead
    low = np.argwhere(nodes >= 0)[:, ::-1] * side - 1.0  # lowest corners (n, 3) of the cubes in voxels, x y z
    nodes = nodes[nodes >= 0]
    luminance = luminance_reference(octree, nodes, rays.direction[ray])
    high = low + side
    if octree.leaf_box is not None:
        first = int(octree.level_start[octree.depth])
        boxed = nodes >= first
        lower, upper = box_bounds(octree.leaf_box[nodes[boxed] - first])
        low[boxed], high[boxed] = low[boxed] + side * lower, low[boxed] + side * upper
    direction, up = rays.direction[ray].astype(np.float64), rays.up[ray].astype(np.float64)
    right = np.cross(direction, up)
    centres = ((np.arange(VIEWPORT_PX) + 0.5) / VIEWPORT_PX - 0.5) * rays.ratio[ray]
    across, upward = np.meshgrid(centres, centres)
    origin = rays.entry_voxel[ray] + across.reshape(-1, 1) * right + upward.reshape(-1, 1) * up
    from_ray = np.abs(((low + high) / 2 - rays.entry_voxel[ray]) @ np.stack([right, up], 1)).max(1)
    near = from_ray < 0.5 + side  # the others are outside the viewport
    low, high, luminance = low[near], high[near], luminance[near]
    if len(low) == 0:
        return 0.0, 0.0
    with np.errstate(divide="ignore"):
        enter, leave = box_interval(origin[:, None], 1.0 / direction, low, high - low)
    enter = np.where(enter <= leave, enter, np.inf)
    hit = np.isfinite(enter).any(1)
    return float(hit.mean()), float(luminance[enter.argmin(1)][hit].mean()) if hit.any() else 0.0
