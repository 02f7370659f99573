# SPDX-License-Identifier: GPL-3.0-or-later
"""Compile the kernels of codes and pictures in a second Python, beside a job that still reads, voxelizes or bakes.

Once on each computer with at least two cores. Failures are not reported: kernels are then compiled when they are
called.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from ...patchnet_addon.runtime.cache_folder import user_cache_folder
from ...patchnet_addon.runtime.threads import usable_cores

SCRIPT = Path(__file__).with_name("call_kernels.py")  # that the second Python runs


@contextmanager
def compiling_beside(*, calls_them: bool = True) -> Iterator[None]:
    """Let a second Python compile while the block runs, no longer than that.

    calls_them: the block itself calls all these kernels, so that they are compiled at its end.
    """
    from ...patchnet_addon.runtime.kernels import compiled_mark

    mark, process, ended = None, None, False
    with suppress(OSError):  # no folder can be written, or no process started
        mark = compiled_mark("pictures")
        is_python = "python" in Path(sys.executable).name.lower()  # a Blender would open a window
        if is_python and usable_cores() > 1 and not mark.exists():
            process = start_second_python()
    try:
        yield
    finally:
        if process is not None:
            ended = process.poll() == 0
            process.kill()
            process.wait()
    if mark is not None and (calls_them or ended):
        with suppress(OSError):
            mark.touch()


def start_second_python() -> subprocess.Popen[bytes]:
    """Start a Python that calls the kernels."""
    package = __name__.removesuffix(".operators.pipeline.kernels_beside")
    words = [sys.executable, str(SCRIPT), package, str(Path(__file__).parents[2]), *sys.path]
    return start_compiler(words, subprocess.DEVNULL)


def start_compiler(words: list[str], said: IO[bytes] | int, **variables: str) -> subprocess.Popen[bytes]:
    """Start a program that compiles kernels into the cache folder of this process.

    said: file for its output. variables: of its environment.
    """
    environment = os.environ | {"PATCHNET_CACHE": str(user_cache_folder())} | variables
    flags = getattr(subprocess, "CREATE_NO_WINDOW", 0)  # else a terminal opens on Windows
    return subprocess.Popen(
        words, stdin=subprocess.DEVNULL, stdout=said, stderr=said, env=environment, creationflags=flags
    )
