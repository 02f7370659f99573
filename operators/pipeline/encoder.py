# SPDX-License-Identifier: GPL-3.0-or-later
"""Choice of the encoder by settings and availability: torch in this Python or in another one, or our own kernels."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ...patchnet_addon.network.weights import Weights
from ...patchnet_addon.runtime.errors import SettingError
from ..schema.table import AUTO, GPU
from ..settings.groups import ComputeSettings

if TYPE_CHECKING:  # it brings numba
    from ...patchnet_addon.network.encode import Encoder

_OWN = "own kernels on the CPU"
_TORCH_DEVICES = {"CPU": "cpu", "GPU": "cuda", AUTO: "auto"}


@dataclass(frozen=True, eq=False)
class Encoding:
    """Encoder, its name in a few words, and sentences about what was asked for and is not there."""

    encoder: Encoder
    text: str
    warnings: tuple[str, ...] = ()


@contextmanager
def chosen_encoder(weights: Weights, compute: ComputeSettings) -> Iterator[Encoding]:
    """Encoder of the settings for these weights; a process of it ends with the block.

    Torch on a GPU of this Python, else the other Python that is named, else our kernels with the same codes. Raises
    SettingError if a GPU is asked for and there is none.
    """
    from ...patchnet_addon.codes.encode import make_encoder
    from ...patchnet_addon.network.other_python import OtherPythonEncoder

    warnings: tuple[str, ...] = ()
    if compute.torch_python is not None:
        try:
            other = OtherPythonEncoder(compute.torch_python, weights, _TORCH_DEVICES[compute.encoder_device])
        except SettingError as error:
            if compute.encoder_device == GPU:
                raise
            warnings = (f"{error}. Encoding used PatchNet's own kernels instead, with the same result",)
        else:
            with other:
                yield Encoding(other, f"torch {other.said['torch']} on {other.said['device']}, another Python")
            return
    if compute.encoder_device == GPU or (compute.encoder_device == AUTO and torch_has_gpu()):
        yield Encoding(make_encoder(weights, "torch", "cuda"), "torch on a GPU", warnings)
        return
    yield Encoding(make_encoder(weights, "compiled"), _OWN, warnings)


def encoder_text(compute: ComputeSettings) -> str:
    """Name of the encoder that would run, in a few words, without starting anything."""
    if compute.torch_python is not None:
        return f"torch of {compute.torch_python.name}"
    if compute.encoder_device == GPU or (compute.encoder_device == AUTO and torch_has_gpu()):
        return "torch on a GPU"
    return _OWN


def torch_has_gpu() -> bool:
    """Return whether this Python has torch, and torch an NVIDIA GPU; torch is imported only where there may be one."""
    if importlib.util.find_spec("torch") is None:
        return False
    if sys.platform == "linux" and not Path("/dev/nvidiactl").exists():
        return False
    import torch

    return bool(torch.cuda.is_available())
