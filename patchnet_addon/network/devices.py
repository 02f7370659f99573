# SPDX-License-Identifier: GPL-3.0-or-later
"""Device names of the network: auto, cpu, cuda (torch's present GPU), cuda:N; imports torch late."""

from __future__ import annotations

import importlib.util
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..runtime.errors import SettingError

AUTO, CPU, CUDA = "auto", "cpu", "cuda"
FORMS = "auto, cpu, cuda, or cuda:N with the number of a GPU"
_INSTALL = "install PyTorch with CUDA (docs/gpu.md)"


def read_device(text: str, what: str = "Device") -> str:
    """Name of a device as torch writes it; raises SettingError, which names the setting `what`, for anything else."""
    name = text.strip().lower()
    if name not in (AUTO, CPU, CUDA) and not re.fullmatch(r"cuda:\d{1,4}", name):
        raise SettingError(f"{what} {text!r} is unknown: choose {FORMS}")
    return name


def found_device(text: str, what: str = "Device") -> str:
    """Device of a name on this machine: "cpu", or "cuda:N" of a GPU that torch can use.

    auto is the GPU if torch has one, else the CPU. Raises SettingError for a missing GPU.
    """
    name = read_device(text, what)
    if name == CPU or (name == AUTO and not torch_has_gpu()):
        return CPU
    if not has_torch():
        raise SettingError(f"{what} '{name}' needs PyTorch, which this Python does not have: {_INSTALL}, or choose cpu")
    import torch

    if not torch.cuda.is_available():
        raise SettingError(
            f"{what} '{name}' needs an NVIDIA GPU, and PyTorch {torch.__version__} finds none here: {_INSTALL} and the "
            "GPU's driver, or choose cpu"
        )
    number = int(name.partition(":")[2] or torch.cuda.current_device())
    count = torch.cuda.device_count()
    if number >= count:
        there = ", ".join(f"{CUDA}:{index}" for index in range(count))
        raise SettingError(f"{what} '{name}' does not exist: choose one that PyTorch finds ({there}), or cpu")
    return f"{CUDA}:{number}"


def has_torch() -> bool:
    """Return whether this Python has torch, without importing it."""
    return importlib.util.find_spec("torch") is not None


def torch_has_gpu() -> bool:
    """Return whether this Python has torch, and torch an NVIDIA GPU; torch is imported only where there may be one."""
    if not has_torch():
        return False
    if sys.platform == "linux" and not Path("/dev/nvidiactl").exists():
        return False
    import torch

    return bool(torch.cuda.is_available())


def device_title(device: str) -> str:
    """Display name of a device: "CPU", or the GPU's name with its number."""
    if device == CPU:
        return "CPU"
    import torch

    return f"{torch.cuda.get_device_name(device)} ({device})"


@contextmanager
def enough_memory(work: str) -> Iterator[None]:
    """Raise SettingError, with the work and the remedy, if a GPU's memory is too small."""
    try:
        yield
    except RuntimeError as cause:
        if type(cause).__name__ != "OutOfMemoryError":
            raise
        raise SettingError(
            f"The GPU has too little free memory for {work}: free some, or choose another device or cpu"
        ) from cause
