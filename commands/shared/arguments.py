# SPDX-License-Identifier: GPL-3.0-or-later
"""Arguments that are refused with our own sentence before anything is done: numbers and outputs."""

from __future__ import annotations

import argparse
import platform
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Any

from ...patchnet_addon.network.devices import AUTO, read_device
from ...patchnet_addon.runtime.bounds import Bounds
from ...patchnet_addon.runtime.errors import OctreeFileError, OutputError, SettingError
from ...patchnet_addon.runtime.file_kinds import BLEND, GLB, FileKind


def add_number(parser: argparse._ActionsContainer, flag: str, bounds: Bounds, **others: Any) -> None:
    """Add an argument that is a number of the table, or several of them with `nargs`.

    A value outside raises SettingError, which argparse lets through.
    """
    parser.add_argument(flag, type=partial(bounds.read, what=flag), **others)


def add_device(parser: argparse._ActionsContainer, text: str) -> None:
    """Argument `--device`: auto, cpu, cuda or cuda:N; another raises SettingError, which argparse lets through."""
    parser.add_argument(
        "--device", type=partial(read_device, what="--device"), default=AUTO, metavar="auto|cpu|cuda|cuda:N", help=text
    )


def named_file(text: str) -> tuple[str, Path]:
    """Read "station=run/patchnet.safetensors" as a name and a file."""
    name, equals, path = text.partition("=")
    if not (name and equals and path):
        raise argparse.ArgumentTypeError(f"{text!r} is not a name and a file such as station=run/patchnet.safetensors")
    return name, Path(path)


def add_out(parser: argparse.ArgumentParser, text: str, **others: Any) -> None:
    """Path of `--out`, which is not empty; an empty one would be the working folder, not meant to be filled."""
    parser.add_argument("--out", type=_output, help=text, **others)


def _output(text: str) -> Path:
    if not text.strip():
        raise OutputError("--out is empty: give the path of the output, or . for the working folder")
    return Path(text)


def check_octrees(paths: Iterable[Path]) -> None:
    """Raise OctreeFileError for octree files that are not there, before hours go by with those that are."""
    for path in paths:
        if not path.is_file():
            raise OctreeFileError(f"{path} does not exist: name an octree file")


def scene_kind(out: Path) -> FileKind:
    """Kind of the scene file that is to be written at `out`; raises SettingError for an ending of no such file."""
    for kind in (BLEND, GLB):
        if out.suffix.lower() in kind.endings:
            return kind
    raise SettingError(f"--out {out} is no scene file: let it end with .glb or .blend")


_PACKAGES = ("bpy", "numpy", "numba", "torch")


def add_version(parser: argparse.ArgumentParser) -> None:
    """Add --version."""
    parser.add_argument(
        "--version", action=_Version, nargs=0, default=argparse.SUPPRESS,
        help="say the versions of PatchNet, Python and the packages that compute, and exit",
    )  # fmt: skip


class _Version(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        from ...patchnet_addon.runtime.versions import installed_versions, own_version

        found = [f"patchnet {own_version()}", f"Python {platform.python_version()}", *installed_versions(_PACKAGES)]
        print(", ".join(found))
        parser.exit()
