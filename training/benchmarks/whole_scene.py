# SPDX-License-Identifier: GPL-3.0-or-later
"""Benchmark of `patchnet octree`, from a scene file to an octree file, in a process of its own.

Compared is the peak of resident memory of the whole process, Blender included, with what could be predicted before the
octree was built: the largest of the peaks until then, and what was resident then plus the estimate of
`patchnet_addon/lod/depth.py`. A ratio above 1 means that less was taken than predicted.
"""

from __future__ import annotations

import json
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...patchnet_addon.lod.depth import COARSE_DEPTH, estimate
from ...patchnet_addon.octree.file import load_octree
from ...patchnet_addon.octree.grid import Grid
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.errors import PatchNetError
from .child import run_child
from .timing import Comparison

BUILD = "voxelize"
_QUAD = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 1\nf 1 2 3\nf 1 3 4\n"


def benchmark_scene(scene: Path, depth: int, light: str) -> Comparison:
    """Wall seconds of each stage and peak memory; kernels are compiled and Blender is read before, on two triangles.

    Raises PatchNetError if the command fails or the system does not tell the memory of stages (only Linux does).
    """
    with tempfile.TemporaryDirectory(prefix="patchnet-") as name:
        folder = Path(name)
        warm, out = folder / "warm.obj", folder / "octree.safetensors"
        warm.write_text(_QUAD, encoding="ascii")
        octree_of(warm, 3, light, folder / "warm.safetensors")
        built = octree_of(scene, depth, light, out)
        return _compared(built, load_octree(out), out.stat().st_size, light)


@dataclass(frozen=True)
class Built:
    """Cost of `patchnet octree`: wall seconds, the whole process's peak of memory, and the same of each stage."""

    seconds: float
    peak_bytes: int
    stages: dict[str, dict[str, Any]]

    @property
    def before_bytes(self) -> int:
        """Resident memory when building began: Blender, the scene, and its light."""
        return int(self.stages[BUILD]["before_bytes"])


def octree_of(scene: Path, depth: int | str, light: str, out: Path, *more: str) -> Built:
    """Run `patchnet octree` in a process of its own, with `more` arguments.

    Raises PatchNetError if it fails or the system does not tell the memory of stages.
    """
    package = __name__.partition(".training")[0]
    arguments = [str(scene), "--depth", str(depth), "--light", light, "--out", str(out), "--timings", *more]
    child = run_child([sys.executable, "-m", package, "octree", *arguments])
    if child.code:
        how = f"ended with code {child.code}, see above" if child.code > 0 else "was killed, perhaps for want of memory"
        raise PatchNetError(f"{scene} did not become an octree: `patchnet octree` {how}")
    timings = json.loads(child.stdout.splitlines()[-1])
    if timings["peak_bytes"] is None:
        raise PatchNetError("This system does not tell the memory of a process in /proc: use Linux")
    # Counting per stage makes wait4 forget earlier peaks.
    return Built(child.seconds, max(child.peak_bytes, timings["peak_bytes"]), timings["stages"])


def _compared(built: Built, octree: Octree, file_bytes: int, light: str) -> Comparison:
    stages = built.stages
    names = list(stages)
    before = built.before_bytes
    estimated = estimate(cut(octree, COARSE_DEPTH), octree.depth)[2]
    earlier = [stages[name]["peak_bytes"] for name in names[: names.index(BUILD)]]
    predicted = max(*earlier, before + estimated)
    peak = built.peak_bytes
    details = {
        "depth": octree.depth,
        "light": light,
        "triangles": octree.provenance["triangles"],
        "leaves": octree.leaf_count,
        "nodes": octree.node_count,
        "file_bytes": file_bytes,
        "wall_s": built.seconds,
        "stage_s": {name: stage["seconds"] for name, stage in stages.items()},
        "other_s": built.seconds - sum(stage["seconds"] for stage in stages.values()),
        "stage_peak_bytes": {name: stage["peak_bytes"] for name, stage in stages.items()},
        "peak_stage": max(names, key=lambda name: stages[name]["peak_bytes"]),
        "before_build_bytes": before,
        "estimate_build_bytes": estimated,
        "peer_name": "predicted peak",
    }
    return Comparison("scene", peak, predicted, predicted / peak, details, unit="B")


def cut(octree: Octree, depth: int) -> Octree:
    """Octree without what lies below level `depth`, as if it had been voxelized at that depth."""
    depth = min(depth, octree.depth)
    count = int(octree.level_start[depth + 1])
    mask = octree.child_mask[:count].copy()
    mask[octree.level(depth)] = 0
    grid = Grid(octree.grid.origin_world, octree.grid.side_world, depth)
    return Octree(
        grid=grid,
        level_start=octree.level_start[: depth + 2],
        child_mask=mask,
        first_child=octree.first_child[:count],
        area_world=octree.area_world[:count],
        luminance=octree.luminance[:count],
        normal=octree.normal[:count],
        chroma=None if octree.chroma is None else octree.chroma[:count],
        exposure=octree.exposure,
        provenance=octree.provenance,
    )
