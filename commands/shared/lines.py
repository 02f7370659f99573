# SPDX-License-Identifier: GPL-3.0-or-later
"""Messages of commands, for users on the terminal and as log events, and folders of output files."""

from __future__ import annotations

import logging
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...operators.settings.named import with_flags
from ...patchnet_addon.runtime.errors import PatchNetError
from ...patchnet_addon.runtime.log import event, is_json

if TYPE_CHECKING:
    from ...patchnet_addon.octree.octree import Octree


def say_result(text: str, **fields: Any) -> None:
    """Print a result; log `fields` for programs: file, frame, and figures."""
    print(text)
    event("result", text, **fields)


def say_exposure(octree: Octree) -> None:
    """Print the exposure factor and how to set it."""
    from ...patchnet_addon.octree.exposure import exposure_text

    automatic = octree.provenance.get("exposure") == "automatic"
    print(f"{exposure_text(octree)}{', --exposure chooses another one' if automatic else ''}")


def say_note(text: str) -> None:
    """Print an assumption or omission to stderr, so that it is visible when stdout is redirected."""
    text = with_flags(text)
    if not is_json():
        print(f"Note: {text}", file=sys.stderr)
    event("warning", text, logging.WARNING)


def say_error(text: str, exit_code: int) -> None:
    """Print the error that ends the command with `exit_code` to stderr."""
    text = with_flags(text)
    if not is_json():
        print(f"patchnet: {text}", file=sys.stderr)
    event("error", text.removeprefix("error: "), logging.ERROR, exit_code=exit_code)


def make_parent(path: Path) -> None:
    """Create the folder of an output file; raises PatchNetError."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as cause:
        raise PatchNetError(f"{path.parent} cannot be created ({cause.strerror}): choose another folder") from cause
