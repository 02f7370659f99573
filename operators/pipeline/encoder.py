# SPDX-License-Identifier: GPL-3.0-or-later
"""Choice of the encoder by settings and availability: torch in this Python or in another one, or our own kernels."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ...patchnet_addon.network.devices import AUTO, CPU, OTHER_PYTHON, device_title, found_device, torch_has_gpu
from ...patchnet_addon.network.weights import Weights
from ...patchnet_addon.runtime.errors import SettingError
from ..settings.groups import NETWORK_DEVICE, ComputeSettings

if TYPE_CHECKING:  # it brings numba
    from ...patchnet_addon.network.encoders import Encoder
    from ...patchnet_addon.network.product import PackedLayers

_OWN = "own kernels on the CPU"


@dataclass(frozen=True, eq=False)
class Encoding:
    """Encoder, its name in a few words, and sentences about what was asked for and is not there."""

    encoder: PackedLayers | Encoder
    text: str
    warnings: tuple[str, ...] = ()


@contextmanager
def chosen_encoder(weights: Weights, compute: ComputeSettings) -> Iterator[Encoding]:
    """Encoder of the settings for these weights; a process of it ends with the block.

    Torch on a GPU of this Python, else the other Python that is named, else our kernels with the same codes. Raises
    SettingError if a GPU, or torch, is needed and not there.
    """
    from ...patchnet_addon.codes.encode import make_encoder

    warnings: tuple[str, ...] = ()
    wanted = compute.torch_device
    if (python := compute.torch_python) is not None:
        try:
            if not OTHER_PYTHON:
                raise SettingError(f"{python} cannot encode: PatchNet of extensions.blender.org uses no other Python")
            from ...patchnet_addon.network.other_python import OtherPythonEncoder

            other = OtherPythonEncoder(python, weights, wanted)
        except SettingError as error:
            if wanted not in (AUTO, CPU):
                raise
            warnings = (f"{error}. Encoding used PatchNet's own kernels instead, with the same result",)
        else:
            with other:
                yield Encoding(other, f"torch {other.said['torch']} on {other.said['device']}, another Python")
            return
    device = found_device(wanted, NETWORK_DEVICE)
    text = _OWN if device == CPU else f"torch on {device_title(device)}"
    yield Encoding(make_encoder(weights, device=device), text, warnings)


def check_encoder(compute: ComputeSettings) -> None:
    """Raise SettingError if a GPU of this Python is asked for and there is none; another Python speaks for itself."""
    if compute.torch_python is None:
        found_device(compute.torch_device, NETWORK_DEVICE)


def encoder_text(compute: ComputeSettings) -> str:
    """Name of the encoder that would run, in a few words, without starting anything."""
    if compute.torch_python is not None:
        return f"torch of {compute.torch_python.name}"
    if compute.torch_device == CPU or (compute.torch_device == AUTO and not torch_has_gpu()):
        return _OWN
    return "torch on a GPU"
