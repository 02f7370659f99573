# SPDX-License-Identifier: GPL-3.0-or-later
"""Arguments that benches share, and the triangles that `--scene` stands for."""

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


def add_scene(parser: argparse.ArgumentParser, required: bool = True) -> None:
    """Add the argument `--scene FILE`."""
    parser.add_argument("--scene", type=Path, required=required, help="scene file, as for `patchnet run`")


def add_depth(parser: argparse.ArgumentParser) -> None:
    """Add the argument `--depth D`."""
    add_number(parser, "--depth", bounds.DEPTH, default=9, help="octree depth (9)")


def add_repeats(parser: argparse.ArgumentParser, repeats: int) -> None:
    """Add the argument `--repeats N`."""
    add_number(
        parser, "--repeats", bounds.REPEATS, default=repeats, help=f"runs of each, the median counts ({repeats})"
    )


def add_cores(parser: argparse.ArgumentParser) -> None:
    """Add the argument `--cores one|all`."""
    parser.add_argument(
        "--cores",
        choices=("one", "all"),
        default="one",
        help="one: both are bound to one core, processor seconds; all: both may use every core, wall seconds (one)",
    )


def read_triangles(scene: Path) -> np.ndarray:
    """All placed triangles (T, 3, 3) of a scene file, in world units."""
    require_blender()
    import bpy
    import numpy as np

    from ...operators.scene.files import open_scene
    from ...operators.scene.read import read_scene

    with quiet_stdout():
        open_scene(scene)
        source = read_scene(bpy.context.evaluated_depsgraph_get())
        return np.concatenate([batch.corners_world for batch in source.batches()])
