# SPDX-License-Identifier: GPL-3.0-or-later
"""Arguments with PatchNet's own error messages: numbers and outputs."""

from __future__ import annotations

import argparse
import platform
from functools import partial
from pathlib import Path
from typing import Any

from ...patchnet_addon.network.devices import AUTO, read_device
from ...patchnet_addon.runtime.bounds import Bounds
from ...patchnet_addon.runtime.errors import OutputError

_PACKAGES = ("bpy", "numpy", "numba", "torch")


def add_number(
    parser: argparse._ActionsContainer, flag: str, bounds: Bounds, text: str, default: Any = None, **others: Any
) -> None:
    """Add a numeric argument with bounds of the table, or several numbers if its default has several.

    The help states the default. A value outside its bounds raises SettingError, which argparse passes on.
    """
    values = default if isinstance(default, tuple) else () if default is None else (default,)
    text += f" ({' '.join(f'{value:g}' if value < 10_000 else f'{value:,}' for value in values)})" if values else ""
    count = {"nargs": len(default)} if isinstance(default, tuple) else {}
    parser.add_argument(flag, type=partial(bounds.read, what=flag), help=text, default=default, **(count | others))


def is_given(args: argparse.Namespace, flag: str) -> bool:
    """Return whether an option is among the words of the command, also as its --no- form or abbreviated."""
    words = {word.partition("=")[0] for word in getattr(args, "words", ()) if word.startswith("--")}
    others = {f"--{name.replace('_', '-')}" for name in vars(args)} - {flag}  # --light is not short for --light-cells
    return any(form.startswith(word) for word in words - others for form in (flag, f"--no{flag[1:]}"))


def add_device(parser: argparse._ActionsContainer, text: str) -> None:
    """Add `--device`: auto, cpu, cuda or cuda:N; others raise SettingError, which argparse passes on."""
    parser.add_argument(
        "--device", type=partial(read_device, what="--device"), default=AUTO, metavar="auto|cpu|cuda|cuda:N", help=text
    )


def add_out(parser: argparse.ArgumentParser, text: str, **others: Any) -> None:
    """Add `--out`; an empty path, which would mean the working folder, is an error."""
    parser.add_argument("--out", type=_output, help=text, **others)


def _output(text: str) -> Path:
    if not text.strip():
        raise OutputError("--out is empty: give the path of the output, or . for the working folder")
    return Path(text)


def add_version(parser: argparse.ArgumentParser) -> None:
    """Add --version."""
    parser.add_argument(
        "--version", action=_Version, nargs=0, default=argparse.SUPPRESS,
        help="print the versions of PatchNet, Python and numerical packages, and exit",
    )  # fmt: skip


class _Version(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        from ...patchnet_addon.runtime.versions import installed_versions, own_version

        found = [f"patchnet {own_version()}", f"Python {platform.python_version()}", *installed_versions(_PACKAGES)]
        print(", ".join(found))
        parser.exit()
