# SPDX-License-Identifier: GPL-3.0-or-later
"""Provenance of a run: command, code, octrees, versions, processor; paths are reduced to their last part."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...patchnet_addon.network.devices import CPU, device_title
from ...patchnet_addon.octree.file import octree_hash
from ...patchnet_addon.runtime.source_hash import ROOT, source_hash
from ...patchnet_addon.runtime.versions import installed_versions
from ..data.dataset import Dataset

_PACKAGES = ("patchnet-blender", "numpy", "numba", "torch")


def describe_data(datasets: Sequence[Dataset], validation: Sequence[Dataset] = ()) -> dict[str, Any]:
    """Names of data sets, hashes of their octrees, and the training code, for the weights' metadata.

    octrees, validation_octrees: hashes by name of a data set, for training and validation. code: hash of the sources of
    samples and training. commit: of a checkout, see `describe_commit`. For a resumed run both are those of its end.
    """
    return {
        "data": [dataset.name for dataset in datasets],
        "octrees": _octree_hashes(datasets),
        "validation_octrees": _octree_hashes(validation),
        "code": source_hash("training.run.trainer", "training.data.samples"),
        "commit": describe_commit(),
    }


def _octree_hashes(datasets: Sequence[Dataset]) -> dict[str, str]:
    return {dataset.name: dataset.metadata.get("octree_hash") or octree_hash(dataset.octree) for dataset in datasets}


def describe_commit(root: Path = ROOT) -> str:
    """Commit of the checkout at `root`, and "with changes" if tracked files differ; empty without one."""
    words = ["git", f"--git-dir={root / '.git'}", f"--work-tree={root}", "describe", "--always", "--abbrev=40"]
    words += ["--exclude=*", "--dirty=, with changes"]
    try:
        return subprocess.run(words, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):  # no git, or an installed package
        return ""


def run_notes(device: str = CPU) -> dict[str, Any]:
    """Command line, versions and machine of this process, for metadata."""
    return {
        "command": describe_command(sys.argv), "versions": describe_versions(), "machine": describe_machine(device)
    }  # fmt: skip


def describe_command(arguments: Sequence[str]) -> str:
    """Command line with paths reduced to their last part."""
    words = []
    for word in arguments:
        name, equals, path = word.partition("=")  # --out=/home/me/run, and NAME=PATH
        if not equals or os.sep in name:  # a path, which may contain an equals sign
            name, equals, path = "", "", word
        words.append(name + equals + (Path(path).name if os.sep in path else path))
    return " ".join(["patchnet", *words[1:]])


def describe_versions() -> str:
    """Versions of Python and of numerical packages."""
    return ", ".join([f"Python {platform.python_version()}", *installed_versions(_PACKAGES)])


def describe_machine(device: str = CPU) -> str:
    """Processor and its number of threads, and the GPU if `device` is one."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.is_file():
        names = [
            line.split(":", 1)[1].strip() for line in info.read_text().splitlines() if line.startswith("model name")
        ]
        model = names[0] if names else model
    threads = f"{os.cpu_count()} threads of {model}"
    return threads if device == CPU else f"{device_title(device)} beside {threads}"
