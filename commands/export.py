# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet export OCTREE`: write the voxels of one level of an octree file for other programs. The ending of --out
selects the format: .ply is a point cloud, .safetensors is the octree down to the level, and .vdb holds the OpenVDB
grids luminance and density, which needs the Python module openvdb. Light is the mean over all sides of a voxel;
.safetensors keeps the sides.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from ..patchnet_addon.runtime import bounds
from ..patchnet_addon.runtime.quantities import counted
from .shared.arguments import add_number, add_out
from .shared.lines import make_parent, say_result


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument("octree", type=Path, help="an octree file, such as octree.safetensors of `patchnet run`")
    add_number(parser, "--level", bounds.LEVEL, "level of the voxels; the root is 0 (the finest)")
    add_out(parser, "file to write", required=True)


def run(args: argparse.Namespace) -> int:
    """Write the file; returns 0; raises PatchNetError."""
    from ..patchnet_addon.export.formats import export_octree, format_of
    from ..patchnet_addon.octree.file import load_octree
    from ..patchnet_addon.runtime.outputs import check_outputs
    from ..patchnet_addon.runtime.progress import drain
    from .shared.progress_lines import progress_lines

    check_outputs({args.out: format_of(args.out).kind}, [args.octree])
    octree = load_octree(args.octree)
    level = octree.depth if args.level is None else args.level
    steps = export_octree(octree, args.out, level)
    make_parent(args.out)
    count = drain(steps, progress_lines())
    text = f"{args.out}: {counted(count, 'voxel')} of level {level}, {args.out.stat().st_size / 2**20:.1f} MiB"
    say_result(text, file=args.out, octree_level=level, voxels=count)
    return 0
