# SPDX-License-Identifier: GPL-3.0-or-later
"""Bytes per node and per voxel of each field of an octree, in memory and on disk, beside published octrees."""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...patchnet_addon.runtime.errors import SettingError
from .arguments import add_depth, add_scene, read_triangles

if TYPE_CHECKING:
    from ...training.benchmarks.timing import Comparison

HELP = "bytes per node and voxel against published octrees"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `patchnet bench nodes`."""
    parser.add_argument("file", type=Path, nargs="?", help="octree file, instead of --scene and --depth")
    add_scene(parser, required=False)
    add_depth(parser)


def measure(args: argparse.Namespace) -> Comparison:
    """Bytes of all fields; raises PatchNetError for a file that is no octree."""
    from ...training.benchmarks.node_bytes import measure_bytes

    if (args.file is None) == (args.scene is None):
        raise SettingError("Give either an octree file or --scene with a scene file")
    if args.file is not None:
        result, name = measure_bytes(args.file), args.file.name
    else:
        with tempfile.TemporaryDirectory(prefix="patchnet-") as folder:
            path = Path(folder) / "octree.safetensors"
            _save_scene(args.scene, args.depth, path)
            result, name = measure_bytes(path), args.scene.name
    return replace(result, details={"file": name, **result.details})


def text(values: dict[str, Any]) -> str:
    """Markdown tables, and what is compared."""
    from ...training.benchmarks.node_bytes import bytes_tables

    return (
        f"{values['file']}: depth {values['depth']}, {values['nodes']:,} nodes, {values['leaves']:,} voxels\n\n"
        f"{bytes_tables(values)}\n\n"
        f"{values['ours']:.2f} B per node; at most {values['bar']:.0f} are allowed. {values['peer_name']} takes about "
        f"{values['peer']:.0f}, ratio {values['ratio']:.2f}: {values['compared']}."
    )


def _save_scene(scene: Path, depth: int, path: Path) -> None:
    """Light changes no size, so it is constant."""
    from ...patchnet_addon.octree.file import save_octree
    from ...patchnet_addon.octree.grid import Grid
    from ...training.benchmarks.voxelize import OurVoxels

    ours = OurVoxels(read_triangles(scene))
    ours.voxelize(Grid.around(ours.mesh.bounds_world, depth))
    assert ours.octree is not None
    save_octree(ours.octree, path)
