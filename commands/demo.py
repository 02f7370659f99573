# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet demo`: build the demo courtyard, save it, and run the whole job on its cameras Far, Middle and Close."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from ..patchnet_addon.runtime.errors import PatchNetError
from .run import print_result, run_with_lines
from .shared.arguments import add_out
from .shared.job_arguments import add_job_arguments, job_settings, require_blender

SCENE_NAME = "courtyard.blend"
CAMERAS = "Far,Middle,Close"
DEPTH = "10"  # look-ahead in Far and Middle; Close shows the result without


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    add_job_arguments(parser)
    parser.set_defaults(cameras=CAMERAS, depth=DEPTH)
    add_out(parser, "folder for the results (out/demo)", default=Path("out/demo"))


def run(args: argparse.Namespace) -> int:
    """Build, save, run, print; returns 0; raises PatchNetError."""
    require_blender()
    from ..operators.demo_scene import save_demo_scene
    from ..operators.pipeline.output_files import check_job
    from ..operators.scene.files import open_scene
    from ..patchnet_addon.runtime.file_kinds import BLEND
    from ..patchnet_addon.runtime.outputs import check_outputs
    from .shared.quiet import quiet_stdout

    start = time.monotonic()
    settings = job_settings(args, args.out)
    scene = args.out / SCENE_NAME
    check_job(settings, None, frames=False)
    check_outputs({scene: BLEND})
    try:
        args.out.mkdir(parents=True, exist_ok=True)
        with quiet_stdout():
            save_demo_scene(scene.absolute())
    except (OSError, RuntimeError) as cause:
        raise PatchNetError(f"{scene} cannot be written ({cause}): choose another folder with --out") from cause
    with quiet_stdout():
        open_scene(scene)
    print_result(run_with_lines(settings), settings)
    print(f"The scene is {scene}; everything took {time.monotonic() - start:.0f} s")
    return 0
