# SPDX-License-Identifier: GPL-3.0-or-later
"""Compile kernels in a second Blender without a window, and wait for it; once on each computer.

Compiling in this process would leave 600 MB of fragmented LLVM memory, and holds Python's lock, so that the window
stutters. Loading kernels from the cache takes a tenth of that memory.
"""

from __future__ import annotations

import logging
import math
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import IO

import bpy

from ...patchnet_addon.runtime.cache_folder import user_cache_folder
from ...patchnet_addon.runtime.compiling import NOTE
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.runtime.worker import computed
from ..properties.preferences import ROOT_PACKAGE
from ..scene_access.window_state import Part

SCRIPT = Path(__file__).with_name("small_jobs.py")  # that the other Blender runs
ABOUT = 315  # kernels that the small jobs call, for the progress
_AT = Progress(0, ABOUT, "Compiling kernels", note=NOTE, waiting=True)
_LOOK_S = 0.5  # between two counts of compiled kernels
_LOG_BYTES = 2000  # of the end of its output, for the log
_tried = Part("failed_marks", set[Path])  # marks of failed attempts


def compiled_ahead() -> Steps[None]:
    """Wait until all kernels are in the cache; after a logged failure, they are compiled when they are called.

    Closing these steps stops the other Blender; kernels that it has compiled stay in the cache.
    """
    mark = None
    try:
        mark = yield from computed(_mark, _AT)
        if mark.exists() or mark in _tried():
            return
        yield from _compiled(mark.parent)
        mark.touch()
    except OSError as cause:
        if mark is not None:
            _tried().add(mark)
        logging.getLogger("patchnet").warning(
            "Kernels could not be compiled ahead: they are compiled when they are first called, which takes more "
            "memory. %s", cause,
        )  # fmt: skip


def _compiled(folder: Path) -> Steps[None]:
    with tempfile.TemporaryFile() as said:
        process, looked, at = start_other_blender(said), -math.inf, _AT
        try:
            while process.poll() is None:
                if time.monotonic() - looked >= _LOOK_S:
                    count = sum(1 for _ in folder.rglob("*.nbc"))
                    at, looked = replace(_AT, done=min(count, ABOUT - 1)), time.monotonic()
                yield at
        finally:
            process.kill()
            process.wait()
        if process.returncode:
            said.seek(max(0, said.seek(0, os.SEEK_END) - _LOG_BYTES))
            text = said.read().decode(errors="replace")
            raise ChildProcessError(f"The other Blender ended with exit code {process.returncode} and said: {text}")


def _mark() -> Path:
    """Path of a file that marks all kernels as compiled for this Blender."""
    from ...patchnet_addon.runtime.kernels import compiled_mark

    return compiled_mark(bpy.app.version_string)


def start_other_blender(said: IO[bytes]) -> subprocess.Popen[bytes]:
    """Start a Blender with factory settings, in which small jobs compile missing kernels."""
    words = [bpy.app.binary_path, "--background", "--factory-startup", "--python-exit-code", "1"]
    words += ["--python", str(SCRIPT), "--", ROOT_PACKAGE, str(Path(__file__).parents[2]), *sys.path]
    environment = os.environ | {"PATCHNET_CACHE": str(user_cache_folder()), "PATCHNET_KEEP": "0"}
    flags = getattr(subprocess, "CREATE_NO_WINDOW", 0)  # else a terminal opens on Windows
    return subprocess.Popen(
        words, stdin=subprocess.DEVNULL, stdout=said, stderr=said, env=environment, creationflags=flags
    )
