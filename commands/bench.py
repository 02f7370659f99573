# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet bench NAME`: measure against other programs, in the same run and on the same input."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from ..patchnet_addon.errors import SettingError
from .quiet import quiet_stdout
from .run import require_blender

if TYPE_CHECKING:
    import numpy as np


def add_parser(subparsers: argparse._SubParsersAction) -> argparse.ArgumentParser:  # type: ignore[type-arg]
    """Arguments of `patchnet bench`."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "bench",
        help="measure against other programs",
        description="Measure a part of PatchNet against another program, in the same run and on the same input.",
    )
    benches = parser.add_subparsers(dest="bench", metavar="NAME", required=True)
    voxelize = benches.add_parser(
        "voxelize",
        help="octree against Open3D's voxel grid, on one core",
        description="Time clipping, averaging and building the octree against Open3D's voxel grid, on one core.",
    )
    voxelize.add_argument("--scene", type=Path, required=True, help="scene file, as for `patchnet run`")
    voxelize.add_argument("--depth", type=int, default=9, help="octree depth (9)")
    voxelize.add_argument("--repeats", type=int, default=3, help="runs of each, the median counts (3)")
    voxelize.add_argument("--json", action="store_true", help="print one line of JSON")
    return parser


def run(args: argparse.Namespace) -> int:
    """Measure and print; returns 0. Raises PatchNetError."""
    from ..training.benchmarks.voxelize import benchmark_voxelize, import_open3d

    if args.repeats < 1:
        raise SettingError(f"{args.repeats} repeats measure nothing: give at least 1")
    import_open3d()  # before a long scene is read
    result = benchmark_voxelize(read_triangles(args.scene), args.depth, args.repeats)
    values = {"scene": args.scene.name, **result.as_json()}
    if args.json:
        print(json.dumps(values))
        return 0
    print(
        f"{args.scene.name} at depth {args.depth}: octree of {values['ours_voxels']:,} voxels in {result.ours:.2f} s, "
        f"{values['peer_name']} {values['peer_voxels']:,} voxels in {result.peer:.2f} s, ratio {result.ratio:.2f}"
    )
    return 0


def read_triangles(scene: Path) -> np.ndarray:
    """All placed triangles (T, 3, 3) of a scene file, in world units."""
    require_blender()
    import bpy
    import numpy as np

    from ..operators.scene import open_scene, read_scene

    with quiet_stdout():
        open_scene(scene)
        source = read_scene(bpy.context.evaluated_depsgraph_get())
        return np.concatenate([batch.corners_world for batch in source.batches()])
