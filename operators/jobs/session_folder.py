# SPDX-License-Identifier: GPL-3.0-or-later
"""Temporary folder of this Blender process, which Blender removes only where it ends by itself."""

from __future__ import annotations

import re
from pathlib import Path

import bpy

from ...patchnet_addon.runtime.unfinished import goes_with_process

_NAME = re.compile(r"blender_\w{6}")  # without one of its own, Blender names the folder of all temporary files


def session_folder_goes() -> None:
    """Let the folder go with a process that is ended at once, as Blender lets it go with itself."""
    folder = Path(bpy.app.tempdir)
    if _NAME.fullmatch(folder.name):
        goes_with_process(folder)
