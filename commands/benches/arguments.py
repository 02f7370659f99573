# SPDX-License-Identifier: GPL-3.0-or-later
"""Arguments that benches share, and the octree, triangles and process that they stand for."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from ...patchnet_addon.runtime import bounds
from ..shared.arguments import add_number
from ..shared.job_arguments import require_blender
from ..shared.quiet import quiet_stdout

if TYPE_CHECKING:
    import numpy as np

    from ...patchnet_addon.octree.octree import Octree
    from ...training.benchmarks.timing import Comparison

SHELLS = "shells"  # bumpy spheres inside each other, where no scene is given


def add_scene(parser: argparse.ArgumentParser) -> None:
    """Add the argument `--scene FILE`."""
    parser.add_argument("--scene", type=Path, help="scene file, as for `patchnet run` (a bumpy sphere)")


def add_octree(parser: argparse.ArgumentParser, nodes: int) -> None:
    """Add an octree file, and `--nodes N` of the one that is made without it."""
    parser.add_argument("file", type=Path, nargs="?", help="octree file (one of --nodes nodes is made)")
    add_number(parser, "--nodes", bounds.NODES, default=nodes, help=f"nodes of the octree that is made ({nodes})")


def add_depth(parser: argparse.ArgumentParser, depth: int = 9) -> None:
    """Add the argument `--depth D`."""
    add_number(parser, "--depth", bounds.DEPTH, default=depth, help=f"octree depth ({depth})")


def add_threads(parser: argparse.ArgumentParser, text: str) -> None:
    """Add the argument `--threads N`, one by default."""
    add_number(parser, "--threads", bounds.THREADS, default=1, help=f"{text}; one: processor seconds (1)")


def add_repeats(parser: argparse.ArgumentParser, repeats: int) -> None:
    """Add the argument `--repeats N`."""
    add_number(
        parser, "--repeats", bounds.REPEATS, default=repeats, help=f"runs of each, the median counts ({repeats})"
    )


def given_octree(args: argparse.Namespace) -> tuple[Octree, str]:
    """Octree of `add_octree` and its name; raises PatchNetError for a file that is none."""
    from ...patchnet_addon.octree.file import load_octree
    from ...training.benchmarks.shells import octree_of_shells

    if args.file is not None:
        return load_octree(args.file), args.file.name
    return octree_of_shells(args.nodes), SHELLS


def read_triangles(scene: Path | None) -> np.ndarray:
    """All placed triangles (T, 3, 3) of a scene file, in world units, or those of a bumpy sphere."""
    if scene is None:
        from ...training.benchmarks.shells import shell_triangles

        return shell_triangles(1.0)
    require_blender()
    import bpy
    import numpy as np

    from ...operators.scene.files import open_scene
    from ...operators.scene.read import read_scene

    with quiet_stdout():
        open_scene(scene)
        source = read_scene(bpy.context.evaluated_depsgraph_get())
        return np.concatenate([batch.corners_world for batch in source.batches()])


def in_other_process(args: argparse.Namespace, *names: str) -> Comparison | None:
    """Result of the same bench, with these of its arguments, in a process of `--threads` threads; None if this is one.

    BLAS and torch take their number of threads when they are loaded.
    """
    from ...training.benchmarks.timing import has_threads, run_with_threads

    if has_threads(args.threads):
        return None
    words = [args.bench, *([str(args.file)] if args.file is not None else [])]
    for name in ("threads", "nodes", "repeats", *names):
        if (value := getattr(args, name)) is not None:
            words += [f"--{name}", str(value)]
    return run_with_threads(words, args.threads)
