# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays per second of the tracer in turns with Embree on the same triangles (https://pypi.org/project/embreex).

Views are found from the octree: from far outside, from the free space within, and close to what that sees.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from statistics import geometric_mean, median
from types import ModuleType
from typing import Any

import numpy as np

from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.errors import PatchNetError
from ...patchnet_addon.runtime.progress import drain
from ...patchnet_addon.runtime.threads import limit_threads
from ...patchnet_addon.tracing.camera import PERSPECTIVE, Camera, camera_in_unit_cube
from ...patchnet_addon.tracing.render import first_hits, trace_pixels, visits_per_ray
from ...patchnet_addon.tracing.supersample import supersample_pixels
from ...patchnet_addon.tracing.tile import BEHIND, COARSE, FINE, Search
from ...patchnet_addon.tracing.viewpoints import viewpoints
from .timing import Comparison, take_turns

_BLOCK = 4  # pixels a side that are super-sampled together, as refinement does
_BLOCKS = 40
_SIDE = 32
_CLOSE = 0.15  # of the way from what the view within sees back to it


def import_embree() -> ModuleType:
    """Embree's scenes, or a PatchNetError that says how to get them."""
    try:
        from embreex import mesh_construction, rtcore_scene  # noqa: F401
    except (ImportError, OSError) as cause:
        raise PatchNetError(f"Embree cannot be imported ({cause}): install patchnet-blender[peers]") from cause
    return rtcore_scene


class EmbreeScene:
    """Triangles (T, 3, 3) in Embree's bounding volume hierarchy."""

    def __init__(self, corners_world: np.ndarray) -> None:
        """Build the hierarchy; around the middle of the triangles, since Embree computes in float32."""
        from embreex.mesh_construction import TriangleMesh

        self._scene = import_embree().EmbreeScene()
        corners = corners_world.reshape(-1, 3)
        self._middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
        TriangleMesh(self._scene, (corners_world - self._middle).astype(np.float32))

    @property
    def name(self) -> str:
        """Program and version."""
        from importlib.metadata import version

        return f"Embree {version('embreex').partition('.post')[0]}"

    def rays(self, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
        """Origins and directions (P, 3) float32 of the pixels' centre rays; made before anything is timed."""
        row, column = np.divmod(np.arange(camera.pixel_count), camera.width_px)
        x = (2 * column + 1) / camera.width_px - 1 + camera.shift_x
        y = (2 * row + 1) / camera.height_px - 1 + camera.shift_y
        across = x[:, None] * camera.half_x * camera.right + y[:, None] * camera.half_y * camera.up
        origin = np.repeat((camera.position_world - self._middle)[None], camera.pixel_count, axis=0)
        if camera.kind == PERSPECTIVE:
            direction = camera.forward + across
        else:
            origin, direction = origin + across, np.repeat(camera.forward[None], camera.pixel_count, axis=0)
        direction = direction / np.linalg.norm(direction, axis=1, keepdims=True)
        return origin.astype(np.float32), direction.astype(np.float32)

    def trace(self, rays: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        """Triangles (P,) int32 that rays meet first, -1 for none."""
        found: np.ndarray = self._scene.run(*rays, query="INTERSECT")
        return found


def benchmark_tracing(
    octree: Octree,
    cameras: Sequence[Camera],
    embree: EmbreeScene | None = None,
    repeats: int = 5,
    *,
    threads: int = 1,
) -> Comparison:
    """Rates of all cameras; their geometric mean over Embree's is the ratio, None without Embree.

    One thread is bound to a core and measured in processor seconds, several in wall seconds; Embree has one in any
    case.
    """
    with limit_threads(threads):
        rows = [_view(octree, camera, embree, repeats, threads) for camera in cameras]
    ours = geometric_mean([row["rays_per_s"]["ours"] for row in rows])
    peer = None if embree is None else geometric_mean([row["rays_per_s"]["embree"] for row in rows])
    details = {
        "depth": octree.depth,
        "nodes": octree.node_count,
        "threads": threads,
        "clock": "wall" if threads > 1 else "processor",
        "repeats": repeats,
        "peer_name": None if embree is None else embree.name,
        "size": [cameras[0].width_px, cameras[0].height_px],
        "views": rows,
    }
    return Comparison("trace", ours, peer, None if peer is None else ours / peer, details, unit="rays per second")


def views_of(octree: Octree, size_px: tuple[int, int]) -> list[Camera]:
    """Views Far, Inside and Close of an octree with light; Inside is the best of the places with room.

    Where no place has room, both others look from the same side as Far, from nearer.
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
    """Rates of one camera, and what the second and third answer of a walk cost."""
    unit = camera_in_unit_cube(camera, octree.grid)
    coarse = Search(unit.side_at_0, unit.side_per_z, 0.25, COARSE, octree.depth)
    pixels = _blocks(camera)
    runs: dict[str, Callable[[], Any]] = {
        "ours": partial(trace_pixels, octree, camera, coarse),
        "leaves": partial(trace_pixels, octree, camera, coarse._replace(at_0=0.0, per_z=0.0)),
        "fine": partial(trace_pixels, octree, camera, coarse._replace(last=FINE)),
        "behind": partial(trace_pixels, octree, camera, coarse._replace(last=BEHIND)),
        "picture": partial(first_hits, octree, camera),
        "reference": partial(supersample_pixels, octree, camera, pixels, _SIDE),
    }
    if octree.leaf_box is not None:
        solid = replace(octree, leaf_box=None)
        runs["solid"] = partial(trace_pixels, solid, camera, coarse)
        runs["solid_reference"] = partial(supersample_pixels, solid, camera, pixels, _SIDE)
    if embree is not None:
        runs["embree"] = partial(embree.trace, embree.rays(camera))
    for run in runs.values():
        run()  # compiles, and reads the octree into the caches' reach
    turns = take_turns(runs, repeats, all_cores=threads > 1)
    seconds = {name: median(values) for name, values in turns.items()}
    many = {name for name in runs if name.endswith("reference")}
    rays = dict.fromkeys(runs, camera.pixel_count) | dict.fromkeys(many, len(pixels) * _SIDE**2)
    rates = {name: rays[name] / seconds[name] for name in runs}
    return {
        "name": camera.name,
        "hit_share": float(first_hits(octree, camera).hit.mean()),
        "visits_per_ray": visits_per_ray(octree, camera),
        "rays_per_s": rates,
        "ratio": None if embree is None else rates["ours"] / rates["embree"],
        "fine_costs": seconds["fine"] / seconds["ours"] - 1.0,
        "behind_costs": (seconds["behind"] - seconds["fine"]) / seconds["ours"],
        "boxes_cost": _over(seconds, "ours", "solid"),
        "boxes_cost_reference": _over(seconds, "reference", "solid_reference"),
    }


def _over(seconds: dict[str, float], one: str, other: str) -> float | None:
    """What one run takes more than another, as a share of that; None where there was no other."""
    return seconds[one] / seconds[other] - 1.0 if other in seconds else None


def _blocks(camera: Camera) -> np.ndarray:
    """Pixels (N,) int64 of small squares all over the picture, always the same."""
    rng = np.random.default_rng(0)
    rows = rng.integers(0, max(camera.height_px - _BLOCK, 1), _BLOCKS)
    columns = rng.integers(0, max(camera.width_px - _BLOCK, 1), _BLOCKS)
    inside = np.arange(_BLOCK)
    row = np.minimum(rows[:, None, None] + inside[:, None], camera.height_px - 1)
    column = np.minimum(columns[:, None, None] + inside, camera.width_px - 1)
    return np.unique(row * camera.width_px + column)
