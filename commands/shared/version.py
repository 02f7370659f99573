# SPDX-License-Identifier: GPL-3.0-or-later
"""Option --version: versions of PatchNet and of what it computes with, as a report of a fault needs them."""

from __future__ import annotations

import argparse
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

_MANIFEST = Path(__file__).parents[2] / "blender_manifest.toml"
_PACKAGES = ("bpy", "numpy", "numba", "torch")


def add_version(parser: argparse.ArgumentParser) -> None:
    """Add --version."""
    parser.add_argument(
        "--version", action=_Version, nargs=0, default=argparse.SUPPRESS,
        help="say the versions of PatchNet, Python and the packages that compute, and exit",
    )  # fmt: skip


def versions_line() -> str:
    """Versions in a line; packages that are not installed are left out. Imports none of them."""
    import tomllib

    own = tomllib.loads(_MANIFEST.read_text(encoding="utf-8"))["version"]
    found = [f"patchnet {own}", f"Python {platform.python_version()}"]
    for name in _PACKAGES:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            continue
    return ", ".join(found)


class _Version(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        print(versions_line())
        parser.exit()
