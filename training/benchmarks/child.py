# SPDX-License-Identifier: GPL-3.0-or-later
"""Child process of a command: how long it took, what it printed, the most memory it held."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ...patchnet_addon.runtime.errors import PatchNetError


@dataclass(frozen=True)
class Finished:
    """Exit code, wall and processor seconds, most resident memory by wait4(2), and stdout of an ended command."""

    code: int
    seconds: float
    processor_seconds: float
    peak_bytes: int
    stdout: str


def run_child(command: Sequence[str], environment: Mapping[str, str] | None = None) -> Finished:
    """Run `command`; its stderr is ours, and the environment, unless another is given.

    Raises PatchNetError on systems without wait4 (Windows).
    """
    if not hasattr(os, "wait4"):
        raise PatchNetError("The memory of another process cannot be measured on this system: use Linux or macOS")
    start = time.perf_counter()
    child = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
    try:
        stdout = child.stdout.read() if child.stdout is not None else ""
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
    finally:
        if child.returncode is None:
            child.kill()
            child.wait()
        if child.stdout is not None:
            child.stdout.close()
    peak = usage.ru_maxrss * (1 if sys.platform == "darwin" else 1024)
    return Finished(child.returncode, time.perf_counter() - start, usage.ru_utime + usage.ru_stime, peak, stdout)
