# SPDX-License-Identifier: GPL-3.0-or-later
"""Cost of an octree as its depth grows: seconds per fragment, per leaf and per triangle, beside Open3D.

Fragments are the pieces that the leaf grid cuts triangles into; the voxelizer's own clip makes them, and the shade
that it calls counts them. The work is linear in their number where the time per fragment is the same at every depth.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from statistics import median
from typing import Any

import numpy as np

from ...patchnet_addon.lod.depth import available_memory
from ...patchnet_addon.octree.grid import Grid
from ...patchnet_addon.runtime.bounds import MAX_DEPTH
from ...patchnet_addon.runtime.errors import SettingError
from .open3d_peer import BYTES_PER_VOXEL, Open3DVoxels
from .timing import Comparison, how_measured, take_turns
from .voxelize import WARM_DEPTH, OurVoxels


@dataclass(frozen=True)
class DepthCost:
    """Cost of one depth: median seconds of `runs` runs of clipping, averaging and building all levels.

    peer_seconds and peer_voxels are None where Open3D did not run, and peer_skipped then says why.
    """

    depth: int
    triangles: int
    fragments: int
    leaves: int
    nodes: int
    seconds: float
    runs: int
    peer_seconds: float | None = None
    peer_voxels: int | None = None
    peer_skipped: str = ""

    def as_json(self) -> dict[str, Any]:
        """Flat JSON values, with the time per fragment, leaf and triangle in nanoseconds."""
        return asdict(self) | {
            "ns_per_fragment": 1e9 * self.seconds / self.fragments,
            "ns_per_leaf": 1e9 * self.seconds / self.leaves,
            "ns_per_triangle": 1e9 * self.seconds / self.triangles,
        }


def check_depths(first: int, last: int) -> None:
    """Raise SettingError unless 1 <= first <= last <= MAX_DEPTH."""
    if not 1 <= first <= last <= MAX_DEPTH:
        raise SettingError(
            f"Depths {first} to {last} cannot be measured: give --depths FIRST LAST with "
            f"1 <= FIRST <= LAST <= {MAX_DEPTH}"
        )


def measure_depths(
    corners_world: np.ndarray,
    depths: Sequence[int],
    repeats: int = 3,
    *,
    all_cores: bool = False,
    max_seconds: float = 60.0,
    peer_depth: int = MAX_DEPTH,
) -> Iterator[DepthCost]:
    """Cost of each depth for triangles (T, 3, 3), as soon as it is known.

    A depth is run again until `repeats` or, ours and the peer's together, `max_seconds` are reached. Open3D runs up
    to `peer_depth` where its voxels, as many as our leaves, fit into the free memory.
    Raises PatchNetError if Open3D cannot be imported, GeometryError if there is no surface.
    """
    ours = OurVoxels(corners_world)
    theirs = Open3DVoxels(corners_world, Grid.around(ours.mesh.bounds_world, WARM_DEPTH).voxel_size_world)
    for depth in depths:
        grid = Grid.around(ours.mesh.bounds_world, depth)
        yield _measure_depth(ours, theirs, grid, repeats, all_cores, max_seconds, peer_depth)
        ours.octree = None
        theirs.clear()


def _measure_depth(
    ours: OurVoxels,
    theirs: Open3DVoxels,
    grid: Grid,
    repeats: int,
    all_cores: bool,
    max_seconds: float,
    peer_depth: int,
) -> DepthCost:
    """Measure one depth; the first run of ours tells how much memory Open3D will need."""
    settings: dict[str, Any] = {"all_cores": all_cores, "prepare": theirs.clear}
    functions = {"ours": lambda: ours.voxelize(grid)}
    seconds = take_turns(functions, 1, **settings) | {"peer": []}
    assert ours.octree is not None
    leaves, nodes = ours.octree.leaf_count, ours.octree.node_count
    skipped = _reason_to_skip(grid.depth, leaves, peer_depth)
    if not skipped:
        peer = {"peer": lambda: theirs.voxelize(grid.voxel_size_world)}
        seconds |= take_turns(peer, 1, **settings)
        functions |= peer
    peer_voxels = None if skipped else theirs.voxel_count
    left = max_seconds - sum(sum(runs) for runs in seconds.values())
    if repeats > 1 and left > 0:
        for who, runs in take_turns(functions, repeats - 1, max_seconds=left, **settings).items():
            seconds[who] += runs
    return DepthCost(
        depth=grid.depth,
        triangles=ours.mesh.triangle_count,
        fragments=ours.fragments,
        leaves=leaves,
        nodes=nodes,
        seconds=median(seconds["ours"]),
        runs=len(seconds["ours"]),
        peer_seconds=None if skipped else median(seconds["peer"]),
        peer_voxels=peer_voxels,
        peer_skipped=skipped,
    )


def _reason_to_skip(depth: int, leaves: int, peer_depth: int) -> str:
    if depth > peer_depth:
        return f"deeper than {peer_depth}"
    needed, free = leaves * BYTES_PER_VOXEL, available_memory()
    if needed > free:
        return f"needs about {needed / 2**30:.1f} GiB, {free / 2**30:.1f} GiB are free"
    return ""


def linear_cost(costs: Sequence[DepthCost]) -> tuple[float, float, float]:
    """Nanoseconds per triangle and per fragment that explain the times best, and the largest deviation (0.1: 10 %).

    Least squares of relative deviations over the depths; neither price is negative.
    """
    seconds = np.array([cost.seconds for cost in costs])
    counts = np.array([[cost.triangles, cost.fragments] for cost in costs], np.float64)  # (D, 2)
    relative = counts / seconds[:, None]
    fits = []
    for columns in ([0, 1], [1], [0]):
        prices = np.zeros(2)
        prices[columns] = np.linalg.lstsq(relative[:, columns], np.ones(len(costs)), rcond=None)[0]
        fits.append(prices)
    prices = next(prices for prices in fits if (prices >= 0).all())
    deviation = float(np.abs(relative @ prices - 1.0).max())
    return float(1e9 * prices[0]), float(1e9 * prices[1]), deviation


def compare_depths(costs: Sequence[DepthCost], peer_name: str, all_cores: bool) -> Comparison:
    """All depths as one comparison: seconds of both at the deepest depth that Open3D ran."""
    common = [cost for cost in costs if cost.peer_seconds is not None]
    shown = common[-1] if common else costs[-1]
    peer = shown.peer_seconds
    triangle, fragment, deviation = linear_cost(costs)
    details = how_measured(all_cores) | {
        "depth": shown.depth,
        "peer_name": peer_name,
        "peer_depths": [cost.depth for cost in common],
        "triangles": shown.triangles,
        "fit_ns_per_triangle": triangle,
        "fit_ns_per_fragment": fragment,
        "fit_largest_deviation": deviation,
        "depths": [cost.as_json() for cost in costs],
    }
    return Comparison("depths", shown.seconds, peer, peer / shown.seconds if peer is not None else None, details)
