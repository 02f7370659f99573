# SPDX-License-Identifier: GPL-3.0-or-later
"""PatchNet's decoder on torch, on the CPU or a GPU: codes stay there, and are interpolated there."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from .torch_copy import to_device
from .torch_model import MixturePlace, PatchNet, interpolate
from .torch_precision import float32_products
from .weights import Weights

BATCH = 1 << 18  # pixels at once: about 300 MB of a GPU's memory


class TorchDecoder:
    """Decoder of the codes of an octree on a torch device, for example "cpu", "cuda" or "cuda:1".

    In float32 whatever torch is set to; within 1e-3 of `decode.py`, in fact within 1e-5 where outputs are not steep.
    """

    def __init__(self, weights: Weights, codes: np.ndarray, device: str = "cpu") -> None:
        """Copy the decoder and all codes (C, 10) float16 to `device`, 20 bytes a code.

        Raises RuntimeError where torch has no such device, or where its memory is too small.
        """
        self.device = torch.device(device)
        self._model = PatchNet.from_weights(weights).to(self.device).requires_grad_(False)
        self._codes = to_device(codes, self.device)

    def __call__(
        self,
        corners: np.ndarray,
        entry: np.ndarray,
        direction: np.ndarray,
        up: np.ndarray,
        ratio: np.ndarray,
        nearby: tuple[np.ndarray, ...] | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Coverage (N,) and luminance (N,), float32 in [0, 1], behind N pixels.

        corners: (N, 8) rows of `codes` of the hit voxel's corners, x fastest. entry: (N, 3) point in the voxel,
        [0, 1]^3. direction, up: (N, 3) unit vectors in octree axes (methods 7.14). ratio: (N,) pixel-voxel ratio.
        nearby: of a luminance mixture: view (N, 9), coverage (N, 64) and luminances (N, 65), see `MixtureInputs`.
        """
        outputs = np.empty((2, len(corners)), np.float32)
        for start in range(0, len(corners), BATCH):
            batch = slice(start, min(start + BATCH, len(corners)))
            rows = torch.from_numpy(corners[batch].astype(np.int64)).to(self.device)
            parts = [self._floats(array[batch]) for array in (entry, direction, up, ratio)]
            place = None if nearby is None else tuple(self._floats(array[batch]) for array in nearby)
            outputs[:, batch] = self.decode_tensors(rows, *parts, nearby=place).T.cpu().numpy()
        return outputs[0], outputs[1]

    @torch.inference_mode()
    def decode_tensors(
        self,
        corners: Tensor,
        entry: Tensor,
        direction: Tensor,
        up: Tensor,
        ratio: Tensor,
        *,
        nearby: tuple[Tensor, ...] | None = None,
    ) -> Tensor:
        """Coverage and luminance (N, 2) of what is on the device already, see `__call__`; corners are int64."""
        with float32_products(self.device):
            eight = self._codes[corners].float()
            codes = interpolate(eight, entry)  # (N, 10)
            if nearby is not None:
                place = MixturePlace(eight, *nearby)
                return self._model.decode_mixture(codes, place, direction, up, ratio).clamp_(0, 1)
            return self._model.decode(codes, direction, up, ratio).clamp_(0, 1)

    def _floats(self, array: np.ndarray) -> Tensor:
        return torch.from_numpy(np.array(array, np.float32, order="C")).to(self.device)
