# SPDX-License-Identifier: GPL-3.0-or-later
"""Arguments of research: named files, octree files."""

import argparse
from collections.abc import Iterable
from pathlib import Path

from ...patchnet_addon.runtime.errors import OctreeFileError


def named_file(text: str) -> tuple[str, Path]:
    """Parse "station=run/patchnet.safetensors" as a name and a file."""
    name, equals, path = text.partition("=")
    if not (name and equals and path):
        raise argparse.ArgumentTypeError(f"{text!r} is not a name and a file such as station=run/patchnet.safetensors")
    return name, Path(path)


def check_octrees(paths: Iterable[Path]) -> None:
    """Raise OctreeFileError for missing octree files before the work starts."""
    for path in paths:
        if not path.is_file():
            raise OctreeFileError(f"{path} does not exist: name an octree file")
