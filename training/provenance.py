# SPDX-License-Identifier: GPL-3.0-or-later
"""Provenance of a run: command, versions, processor; paths are cut to their last part."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path

from ..patchnet_addon.network.devices import CPU, device_title

_PACKAGES = ("patchnet-blender", "numpy", "numba", "torch")


def describe_command(arguments: Sequence[str]) -> str:
    """Command line with paths cut to their last part."""
    words = [Path(word).name if os.sep in word else word for word in arguments]
    return " ".join(["patchnet", *words[1:]])


def describe_versions() -> str:
    """Versions of Python and of the packages that a result depends on."""
    found = [f"Python {platform.python_version()}"]
    for package in _PACKAGES:
        try:
            found.append(f"{package} {metadata.version(package)}")
        except metadata.PackageNotFoundError:
            continue
    return ", ".join(found)


def describe_machine(device: str = CPU) -> str:
    """Processor and number of its threads, and the GPU if `device` is one."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.is_file():
        names = [
            line.split(":", 1)[1].strip() for line in info.read_text().splitlines() if line.startswith("model name")
        ]
        model = names[0] if names else model
    threads = f"{os.cpu_count()} threads of {model}"
    return threads if device == CPU else f"{device_title(device)} beside {threads}"
