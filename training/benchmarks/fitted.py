# SPDX-License-Identifier: GPL-3.0-or-later
"""Camera-fitted octrees beside uniform ones: `patchnet octree` in processes of their own.

Compared is the share of the views' hit pixels with look-ahead (methods 4.1b), in the view with least of it. The peer is
the deepest uniform octree that can be expected to be built in the same memory; what the uniform octree of the full
depth would take is stated beside them, by estimate.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...patchnet_addon.lod.depth import COARSE_DEPTH, estimate
from ...patchnet_addon.lod.detail import lookahead_share
from ...patchnet_addon.octree.file import load_octree
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.tracing.camera import Camera
from .timing import Comparison
from .whole_scene import Built, cut, octree_of


def benchmark_fit(
    scene: Path, views: Sequence[Sequence[float]], cameras: Sequence[Camera], memory_gib: float
) -> Comparison:
    """Build both and look through the cameras, which are what `views` say to the command.

    memory_gib: for the whole process, Blender and the scene included. Raises PatchNetError if a command fails.
    """
    with tempfile.TemporaryDirectory(prefix="patchnet-") as name:
        folder = Path(name)
        size = [str(pixels) for pixels in (cameras[0].width_px, cameras[0].height_px)]
        words = [word for view in views for word in ("--view", *(repr(value) for value in view))]
        warm = octree_of(scene, 7, "two-lights", folder / "warm.safetensors")  # the scene's own memory, kernels
        free = memory_gib - warm.before_bytes / 2**30
        out = folder / "fitted.safetensors"
        fitted = octree_of(scene, "fit", "two-lights", out, *words, "--size", *size, "--memory", f"{free:.3f}")
        octree = load_octree(out)
        coarse = cut(octree, COARSE_DEPTH)
        rows = [_row("fitted to the views", octree, fitted, cameras)]
        depth = max(d for d in range(1, octree.depth + 1) if estimate(coarse, d)[2] <= free * 2**30)
        out = folder / "uniform.safetensors"
        uniform = octree_of(scene, depth, "two-lights", out)
        rows.append(_row(f"uniform, depth {depth}", load_octree(out), uniform, cameras))
        rows.append(_estimated(coarse, octree.depth))
    ours, peer = rows[0]["lookahead_share"], rows[1]["lookahead_share"]
    details = {
        "memory_gib": memory_gib,
        "views": len(cameras),
        "size": [cameras[0].width_px, cameras[0].height_px],
        "octrees": rows,
        "peer_name": rows[1]["name"],
    }
    return Comparison("fit", ours, peer, ours / peer if peer > 0 else None, details, unit="share")


def _row(name: str, octree: Octree, built: Built, cameras: Sequence[Camera]) -> dict[str, Any]:
    shares = [lookahead_share(octree.nodes, octree.grid, camera) for camera in cameras]
    return {
        "name": name,
        "depth": octree.depth,
        "leaves": octree.leaf_count,
        "nodes": octree.node_count,
        "octree_bytes": octree.nbytes,
        "peak_bytes": built.peak_bytes,
        "wall_s": built.seconds,
        "stage_s": {stage: values["seconds"] for stage, values in built.stages.items()},
        "stage_peak_bytes": {stage: values["peak_bytes"] for stage, values in built.stages.items()},
        "lookahead_share": min(shares),
        "lookahead_shares": shares,
    }


def _estimated(coarse: Octree, depth: int) -> dict[str, Any]:
    leaves, octree_bytes, peak = estimate(coarse, depth)
    return {
        "name": f"uniform, depth {depth}, estimated",
        "depth": depth,
        "leaves": leaves,
        "octree_bytes": octree_bytes,
        "peak_bytes": peak,
        "wall_s": None,
        "lookahead_share": None,
    }
