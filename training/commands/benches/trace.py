# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays per second of the tracer in turns with Embree on the same triangles (https://pypi.org/project/embreex).

Views are given, or found in the octree: from far outside, from the free space within, and close to a surface.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from importlib.metadata import version
from statistics import geometric_mean
from typing import Any

import numpy as np

from ....commands.shared.views import view_cameras
from ....patchnet_addon.octree.file import load_octree
from ....patchnet_addon.octree.octree import Octree
from ....patchnet_addon.runtime.errors import PatchNetError, SceneError
from ....patchnet_addon.runtime.progress import drain
from ....patchnet_addon.runtime.threads import limit_threads
from ....patchnet_addon.surface.mesh import TriangleMesh
from ....patchnet_addon.tracing.camera import Camera, camera_in_unit_cube
from ....patchnet_addon.tracing.render import first_hits, trace_pixels, visits_per_ray
from ....patchnet_addon.tracing.supersample import supersample_pixels
from ....patchnet_addon.tracing.tile import COARSE, FINE, Search
from ....patchnet_addon.tracing.viewpoints import viewpoints
from ...benchmarks.timing import comparison, timed
from .inputs import SHELLS, imported, read_triangles, voxelized

_BLOCK = 4  # side in pixels of super-sampled blocks, as in refinement
_BLOCKS = 40
_SIDE = 32
_ROUNDING = 1e-4  # relative, of Embree's float32
_FAR = 1e30
_CLOSE = 0.15  # share of the way back from the surface to the view Inside


class EmbreeScene:
    """Triangles (T, 3, 3) in Embree's bounding volume hierarchy."""

    def __init__(self, corners_world: np.ndarray) -> None:
        """Build the hierarchy around the middle of the triangles, since Embree computes in float32."""
        self._scene = imported("Embree", "embreex.rtcore_scene").EmbreeScene()
        corners = corners_world.reshape(-1, 3)
        self._middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
        meshes = imported("Embree", "embreex.mesh_construction")
        meshes.TriangleMesh(self._scene, (corners_world - self._middle).astype(np.float32))

    def run(self, octree: Octree, camera: Camera, query: str = "INTERSECT") -> Callable[[], Any]:
        """Trace the first hits of a perspective camera's pixels; the rays are generated in advance.

        query: "INTERSECT" for triangles, "DISTANCE" for lengths, above 1e30 for none.
        """
        direction = first_hits(octree, camera).direction
        origin = np.tile((camera.position_world - self._middle).astype(np.float32), (len(direction), 1))
        return partial(self._scene.run, origin, direction, query=query)


def measure(args: argparse.Namespace) -> dict[str, Any]:
    """Rates in all views; the ratio is the geometric mean over Embree's.

    Raises PatchNetError without Embree, except for an octree file alone, which has no triangles.
    """
    triangles = embree = None
    if args.scene is not None or args.file is None:
        imported("Embree", "embreex.rtcore_scene")  # before reading a large scene
        if args.scene is not None and not args.scene.is_file():
            raise SceneError(f"Scene file {args.scene} does not exist: check its path")
        triangles = read_triangles(args.scene)
        embree = EmbreeScene(triangles)
    if triangles is None or args.file is not None:
        octree = load_octree(args.file)
    else:
        octree = voxelized(TriangleMesh.from_arrays(triangles), args.depth, exact=True)
    cameras = view_cameras(args) if args.view else views_of(octree, tuple(args.size))
    with limit_threads(args.threads):
        rows = [_view(octree, camera, embree, args.repeats, args.threads) for camera in cameras]
    given = args.scene or args.file
    details = {
        "scene": given.name if given else SHELLS,
        "depth": octree.depth,
        "nodes": octree.node_count,
        "threads": args.threads,
        "clock": "wall" if args.threads > 1 else "processor",
        "repeats": args.repeats,
        "peer_name": None if embree is None else f"Embree {version('embreex').partition('.post')[0]}",
        "size": list(args.size),
        "views": rows,
    }
    ours = geometric_mean([row["rays_per_s"]["ours"] for row in rows])
    peer = None if embree is None else geometric_mean([row["rays_per_s"]["embree"] for row in rows])
    return comparison("trace", ours, peer, details, "rays per second")


def views_of(octree: Octree, size_px: tuple[int, int]) -> list[Camera]:
    """Views Far, Inside and Close of a lit octree; Inside is the best free place.

    Without a free place, both others look from the side of Far, but closer.
    """
    cells = octree.grid.to_world((octree.cells(level := min(octree.depth, 6)) + 0.5) / (1 << level))
    low, high = cells.min(axis=0), cells.max(axis=0)
    middle, reach = (low + high) / 2, float(np.linalg.norm(high - low))
    out = np.array([0.55, -0.75, 0.4])
    far = Camera.look_at(middle + reach * out, middle, size_px=size_px, name="Far")
    try:
        inside = replace(drain(viewpoints(octree, 1, size_px))[0], name="Inside")
    except PatchNetError:
        inside = Camera.look_at(middle + 0.5 * reach * out, middle, size_px=size_px, name="Inside")
    hits = first_hits(octree, inside.with_size(33, 33))
    seen = hits.z_world[hits.hit]
    forward = float(np.median(seen)) * (1.0 - _CLOSE) if len(seen) else 0.0
    close = replace(inside, position_world=inside.position_world + forward * inside.forward, name="Close")
    return [far, inside, close]


def _view(octree: Octree, camera: Camera, embree: EmbreeScene | None, repeats: int, threads: int) -> dict[str, Any]:
    """Rates of one camera, and the cost of the finer hit of a ray."""
    unit = camera_in_unit_cube(camera, octree.grid)
    coarse = Search(unit.side_at_0, unit.side_per_z, 0.25, COARSE)
    pixels = _blocks(camera)
    runs: dict[str, Callable[[], Any]] = {
        "ours": partial(trace_pixels, octree, camera, coarse),
        "fine": partial(trace_pixels, octree, camera, coarse._replace(last=FINE)),
        "reference": partial(supersample_pixels, octree, camera, pixels, _SIDE),
    }
    if octree.pieces is not None:
        runs["exact"] = partial(trace_pixels, octree, camera, coarse, octree.exact_nodes)
    if embree is not None:
        runs["embree"] = embree.run(octree, camera)
    for run in runs.values():
        run()  # compiles, and warms the caches
    seconds, _ = timed(runs, repeats, threads)
    rays = dict.fromkeys(runs, camera.pixel_count) | {"reference": len(pixels) * _SIDE**2}
    return {
        "name": camera.name,
        "hit_share": float(first_hits(octree, camera).hit.mean()),
        "visits_per_ray": visits_per_ray(octree, camera),
        "rays_per_s": {name: rays[name] / seconds[name] for name in runs},
        "ratio": None if embree is None else seconds["embree"] / seconds["ours"],
        "same_hits": _same_hits(octree, camera, coarse._replace(at_0=0.0, per_z=0.0), embree),
        "fine_costs": seconds["fine"] / seconds["ours"] - 1.0,
    }


def _same_hits(octree: Octree, camera: Camera, leaves: Search, embree: EmbreeScene | None) -> float | None:
    """Share of rays that meet the surface at the place where Embree's do, or both nothing; None without pieces."""
    if embree is None or octree.pieces is None:
        return None
    own = trace_pixels(octree, camera, leaves, octree.exact_nodes)[0].t_world.astype(np.float64)
    other = np.asarray(embree.run(octree, camera, "DISTANCE")(), np.float64)
    met = np.isfinite(own)
    return float(np.mean(np.where(met, np.abs(own - other) <= _ROUNDING * np.maximum(own, other), other > _FAR)))


def _blocks(camera: Camera) -> np.ndarray:
    """Pixels (N,) int64 of small squares spread over the picture, the same in every call."""
    rng = np.random.default_rng(0)
    rows = rng.integers(0, max(camera.height_px - _BLOCK, 1), _BLOCKS)
    columns = rng.integers(0, max(camera.width_px - _BLOCK, 1), _BLOCKS)
    inside = np.arange(_BLOCK)
    row = np.minimum(rows[:, None, None] + inside[:, None], camera.height_px - 1)
    column = np.minimum(columns[:, None, None] + inside, camera.width_px - 1)
    return np.unique(row * camera.width_px + column)
