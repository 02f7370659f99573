# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet bench NAME`: measure PatchNet and other programs in the same run on the same input.

A bench is a module of `benches/`, imported when it runs:

    measure(args) -> dict    the measurement as JSON values, which are printed
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from ...commands import add_log_format
from ...commands.shared.arguments import add_number
from ...commands.shared.job_arguments import add_setting, require_blender
from ...commands.shared.views import add_views
from ...patchnet_addon.runtime import bounds
from .. import bounds as lab_bounds


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the benches."""
    benches = parser.add_subparsers(dest="bench", metavar="NAME", required=True)
    for name, (text, add) in BENCHES.items():
        single = benches.add_parser(name, help=text, description=f"Measure {text}.")
        add(single)
        add_log_format(single)


def run(args: argparse.Namespace) -> int:
    """Measure and print; returns 0; raises PatchNetError."""
    if args.bench in ("bake", "preview", "process", "walkthrough"):
        require_blender()
    bench = import_module(f".benches.{args.bench}", __package__)
    print(json.dumps(bench.measure(args), indent=1))
    return 0


def _triangles(parser: argparse.ArgumentParser, repeats: int, peer: str) -> None:
    parser.add_argument("--scene", type=Path, help="scene file, as for `patchnet run` (a bumpy sphere)")
    add_number(parser, "--depth", bounds.DEPTH, "octree depth", 9)
    text = f"PatchNet's threads; {peer} has one; one: processor seconds"
    add_number(parser, "--threads", lab_bounds.THREADS, text, 1)
    _repeats(parser, repeats)


def _octree(parser: argparse.ArgumentParser, nodes: int, repeats: int) -> None:
    parser.add_argument("file", type=Path, nargs="?", help="octree file (a generated one of --nodes nodes)")
    add_number(parser, "--nodes", lab_bounds.NODES, "nodes of the octree that is made", nodes)
    _repeats(parser, repeats)


def _network(parser: argparse.ArgumentParser, nodes: int, repeats: int) -> None:
    _octree(parser, nodes, repeats)
    parser.add_argument("--weights", type=Path, help="weights file (those that are shipped)")
    add_number(parser, "--threads", lab_bounds.THREADS, "threads of PatchNet and torch; one: processor seconds", 1)


def _repeats(parser: argparse.ArgumentParser, repeats: int) -> None:
    add_number(parser, "--repeats", lab_bounds.REPEATS, "runs of each, the median counts", repeats)


def _trace(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, nargs="?", help="octree file of the scene (voxelized at --depth)")
    _triangles(parser, 5, "Embree")
    add_views(parser)


def _decode(parser: argparse.ArgumentParser) -> None:
    _network(parser, 1_000_000, 9)
    add_number(parser, "--pixels", lab_bounds.DECODED_PIXELS, "pixels with look-ahead, about", 150_000)


def _frame(parser: argparse.ArgumentParser) -> None:
    _octree(parser, 1_000_000, 5)
    add_views(parser)
    add_number(parser, "--threads", lab_bounds.THREADS, "threads (one for each core)")


def _gpu(parser: argparse.ArgumentParser) -> None:
    _frame(parser)
    parser.add_argument("--weights", type=Path, help="weights file (those that are shipped)")


def _bake(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scene", default="room", help="scene file; demo: the courtyard; room: a closed room (room)")
    add_number(parser, "--depth", bounds.DEPTH, "octree depth", 7)
    add_number(parser, "--samples", bounds.SAMPLES, "paths per surfel", 16)


def _process(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scene", default="demo", help="scene file; demo: the courtyard; room: a closed room (demo)")
    _repeats(parser, 5)


def _preview(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scene", default="demo", help="scene file; demo: the courtyard; room: a closed room (demo)")
    parser.add_argument("--camera", default="active", help="the camera (active)")
    add_number(parser, "--size", bounds.VIEW_PX, "pixels of the picture", (192, 192))
    add_number(parser, "--cycles-samples", bounds.CYCLES_SAMPLES, "samples per pixel of Cycles' still", 32)


def _walk(parser: argparse.ArgumentParser) -> None:
    from ...operators.settings.job_settings import TABLE

    parser.add_argument(
        "--scene", default="room",
        help="room; demo: the courtyard; sponza and other names of the catalogue, in PATCHNET_SCENES; or a scene file "
        "(room)",
    )  # fmt: skip
    add_number(parser, "--frames", lab_bounds.TRACK_FRAMES, "frames of the walk", 250)
    add_number(parser, "--size", bounds.VIEW_PX, "pixels of each", (320, 180))
    parser.add_argument("--depth", default="auto", help="octree depth; auto: fine only where the cameras look (auto)")
    add_setting(parser, TABLE["max_samples"])
    add_number(parser, "--timed", lab_bounds.REPEATS, "frames of PatchNet that are timed", 3)
    add_number(parser, "--cycles-timed", lab_bounds.REPEATS, "frames of Cycles that are timed", 1)
    text = "samples per pixel of Cycles' frames"
    add_number(parser, "--cycles-samples", bounds.CYCLES_SAMPLES, text, (1, 2, 4, 8, 32), nargs="+", metavar="N")
    add_number(parser, "--judged", lab_bounds.REPEATS, "frames whose errors are measured", 1)
    add_number(parser, "--error-size", bounds.VIEW_PX, "pixels of these", (160, 90))
    add_number(parser, "--truth", bounds.CYCLES_SAMPLES, "samples that they are judged by", 256)


BENCHES: dict[str, tuple[str, Callable[[argparse.ArgumentParser], None]]] = {
    "voxelize": ("octree against Open3D's voxel grid", lambda parser: _triangles(parser, 3, "Open3D")),
    "trace": ("rays per second against Embree's, thread for thread", _trace),
    "encode": ("the whole encoder against torch's", lambda parser: _network(parser, 600_000, 5)),
    "decode": ("the whole decoder against torch's layers alone", _decode),
    "gpu": ("rays and decoded pixels on a graphics card against the CPU's kernels", _gpu),
    "frame": ("a frame, from camera to priority and picture, against four rays in each pixel", _frame),
    "bake": ("the bake against camera renders: paths per second", _bake),
    "process": ("the start of the engine process, a call, and a scene's surface handed to it", _process),
    "preview": ("the first lit picture and the whole job against Cycles' still of the same view", _preview),
    "walkthrough": (
        "a fly-through, with the bake, against Cycles: who is ahead at equal error, from which frame on",
        _walk,
    ),
}
