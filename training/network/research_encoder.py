# SPDX-License-Identifier: GPL-3.0-or-later
"""Codes of octrees by encoders that the engine does not implement, for evaluations."""

from __future__ import annotations

import numpy as np

from ...patchnet_addon.network.devices import has_torch
from ...patchnet_addon.network.encoders import Encoder
from ...patchnet_addon.network.weights import Weights
from ...patchnet_addon.runtime.errors import SettingError
from ..encoders import ConvolvingKind

_CHUNK = 512  # corners per batch


def research_encoder(weights: Weights) -> Encoder | None:
    """Encoder on torch for weights whose encoder convolves; None for `mlp`. Raises SettingError without torch."""
    if not isinstance(weights.encoder_kind, ConvolvingKind):
        return None
    if not has_torch():
        raise SettingError(
            f"The encoder '{weights.encoder_kind.name}' of these weights needs PyTorch, which this Python does not "
            "have: install it, or choose weights with the encoder 'mlp', such as those that are shipped"
        )
    return _ModelEncoder(weights)


class _ModelEncoder:
    """`Encoder` by the torch module, on the CPU."""

    chunk = _CHUNK

    def __init__(self, weights: Weights) -> None:
        from .patchnet import PatchNet

        self._model = PatchNet(weights)

    def __call__(self, blocks: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Encode, see `Encoder`."""
        import torch

        patches = torch.from_numpy(blocks)[torch.from_numpy(rows.astype(np.int64))]
        with torch.inference_mode():
            codes: np.ndarray = self._model.encode(patches).numpy()
        return codes
