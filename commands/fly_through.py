# SPDX-License-Identifier: GPL-3.0-or-later
"""Light a scene once for all frames of a moving camera, and render them with the render engine.

Settings are those of the file: voxels, light, frames, size and format of the pictures. Before the bake, the command
prints the times to expect, and those of Cycles. Frames that are in the folder are not rendered again.
"""

from __future__ import annotations

import argparse

from .shared.arguments import add_out
from .shared.job_arguments import require_blender, track_of
from .shared.lines import say_note, say_result
from .shared.scene_argument import add_scene, open_given


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    add_scene(parser, ".blend file")
    parser.add_argument(
        "--track", metavar="FIRST-LAST",
        help="frames that the voxels are fitted to, such as 1-250, whatever is rendered (those of the scene as saved)",
    )  # fmt: skip
    add_out(parser, "folder for the pictures (that of the file)")


def run(args: argparse.Namespace) -> int:
    """Bake and render; returns 0; raises PatchNetError."""
    track = track_of(args.track).get("track_frames", (0, 0))
    require_blender()
    import bpy

    from ..operators.render_engine.fly_through import FlyThrough, bake_fly_through, render_fly_through
    from ..patchnet_addon.runtime.frames import frame_range
    from ..patchnet_addon.runtime.progress import drain
    from ..patchnet_addon.runtime.quantities import counted
    from .shared.engine import registered
    from .shared.progress_lines import progress_lines
    from .shared.quiet import quiet_stdout

    with registered():
        open_given(args.scene)
        scene = bpy.context.scene
        scene.patchnet.track_frames = track if any(track) else scene.patchnet.track_frames
        frames = frame_range(scene.frame_start, scene.frame_end, scene.frame_step)
        if args.out is not None:
            scene.render.filepath = f"{args.out.absolute()}/"

        def told(expected: FlyThrough) -> None:
            for line in expected.lines():
                say_note(line)

        with quiet_stdout():
            baked = drain(bake_fly_through(bpy.context, frames, told), progress_lines())
        if baked.result is not None:
            for note in baked.result.all_notes:
                say_note(note)
            with quiet_stdout():
                render_fly_through(scene, frames, baked)
    say_result(f"{counted(len(baked.frames), 'frame')} rendered into {baked.folder}", file=baked.folder)
    return 0
