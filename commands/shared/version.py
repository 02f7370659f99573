# SPDX-License-Identifier: GPL-3.0-or-later
"""Option --version: versions of PatchNet and of what it computes with, as a report of a fault needs them."""

from __future__ import annotations

import argparse
import platform
from typing import Any

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
