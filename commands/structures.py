# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet structures`: compose a scene of bars, slats, meshes, leaves, folds, chequers and text to train on."""

from __future__ import annotations

import argparse

from ..patchnet_addon.runtime import bounds
from .shared.arguments import add_number, add_out, scene_kind
from .shared.job_arguments import require_blender
from .shared.lines import make_parent, say_result


def add_parser(subparsers: argparse._SubParsersAction) -> argparse.ArgumentParser:  # type: ignore[type-arg]
    """Arguments of `patchnet structures`."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "structures",
        help="compose procedural structures to train on",
        description="Compose a scene of structures at the scale of voxels, from a third of a voxel of an octree of "
        "depth 10 to 12 voxels thick: bars, slats, wires, lattices, leaves, folds, debris, chequers, text. The same "
        "seed gives the same scene, every other one another.",
    )
    add_number(parser, "--seed", bounds.SEED, default=1, help="of all random choices (1)")
    add_out(parser, "scene to write: .glb, or .blend with sun and sky", required=True)
    return parser


def run(args: argparse.Namespace) -> int:
    """Compose and write the scene; returns 0; raises PatchNetError."""
    from ..patchnet_addon.runtime.outputs import check_outputs

    check_outputs({args.out: scene_kind(args.out)}, [])
    require_blender()
    from ..operators.furnished_scene import save_composed
    from ..operators.structure_scene import compose_structures
    from .shared.quiet import quiet_stdout

    make_parent(args.out)
    with quiet_stdout():
        count = compose_structures(args.seed)
        save_composed(args.out)
    say_result(f"{args.out}: {count} structures", file=args.out, structures=count)
    return 0
