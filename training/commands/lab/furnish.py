# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet lab furnish LIBRARY...`: compose a room or a garden from furniture libraries of Sweet Home 3D (.sh3f), with
a text file of credits. The same seed gives the same scene.
"""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

from ....commands.shared.arguments import add_number, add_out
from ....commands.shared.job_arguments import require_blender
from ....commands.shared.lines import make_parent, say_note, say_result
from ....patchnet_addon.runtime import bounds
from ....patchnet_addon.runtime.errors import SettingError
from ....patchnet_addon.runtime.quantities import counted
from ...file_kinds import GLB, SCENE_CREDITS

CREDITS = ".credits.txt"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument("libraries", nargs="+", type=Path, metavar="LIBRARY", help=".sh3f files")
    kinds = ("interior", "garden")
    parser.add_argument("--kind", choices=kinds, default=kinds[0], help="a room or a garden (interior)")
    add_number(parser, "--seed", bounds.SEED, "random seed", 1)
    add_out(parser, "scene to write, a .glb file", required=True)


def run(args: argparse.Namespace) -> int:
    """Read the libraries, compose, write scene and credits; returns 0; raises PatchNetError."""
    from ....patchnet_addon.runtime.outputs import check_outputs
    from .furnished.library import common_role, read_library

    credits_file = args.out.with_suffix(CREDITS)
    if args.out.suffix.lower() not in GLB.endings:
        raise SettingError(f"--out {args.out} is not a scene file: use the ending .glb")
    check_outputs({args.out: GLB, credits_file: SCENE_CREDITS}, args.libraries)
    libraries = [read_library(path) for path in dict.fromkeys(args.libraries)]
    common_role(library.role for library in libraries)
    require_blender()
    from ....commands.shared.quiet import quiet_stdout
    from ....patchnet_addon.runtime.replace import replaced_file
    from .furnished.compose import compose_scene, save_composed
    from .furnished.plans import credits_text

    make_parent(args.out)
    with quiet_stdout():
        composed = compose_scene(libraries, args.kind, args.seed)
        save_composed(args.out)
    words = ["lab", "furnish", *(path.name for path in args.libraries), "--kind", args.kind, "--seed", str(args.seed)]
    text = credits_text(
        shlex.join(["patchnet", *words]), composed.role, libraries, composed.plan.placements, composed.own
    )
    with replaced_file(credits_file, SCENE_CREDITS) as file:
        file.write(text.encode())
    if composed.role == "test":
        say_note("this library is for testing only: do not train on this scene")
    count = len(composed.plan.placements)
    say_result(f"{args.out}: {counted(count, 'piece')}; credits are in {credits_file}", file=args.out, pieces=count)
    return 0
