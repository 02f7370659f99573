# SPDX-License-Identifier: GPL-3.0-or-later
"""PatchNet's encoder on torch, on the CPU or a GPU; the scheme is that of `encode.py`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from .encoders import octant_matrices

if TYPE_CHECKING:
    from .weights import Weights

_CHUNKS = (4096, 65536)  # corners at once: the fewest, and the most, which fill a GPU
_MEMORY_SHARE = 4  # divisor of a GPU's free memory for the data of a chunk


@contextmanager
def float32_products(device: torch.device, *, tf32: bool = False) -> Iterator[None]:
    """Use exact float32 for products and convolutions on a GPU within the block, or TF32 if requested.

    TF32 has 10 bits of mantissa; it is torch's default for convolutions. Settings of the process and its environment
    (TORCH_ALLOW_TF32_CUBLAS_OVERRIDE is set in NVIDIA's images) are restored afterwards. Nothing changes on a CPU.
    """
    if device.type != "cuda":
        yield
        return
    libraries, name, wanted = _switches(tf32=tf32)
    before = [getattr(library, name) for library in libraries]
    for library in libraries:
        setattr(library, name, wanted)
    try:
        yield
    finally:
        for library, value in zip(libraries, before, strict=True):
            setattr(library, name, value)


def _switches(*, tf32: bool) -> tuple[list[Any], str, str | bool]:
    """Objects and attributes of the precision of products and convolutions, and their value."""
    products: Any = torch.backends.cuda.matmul
    convolutions: Any = torch.backends.cudnn
    # torch up to 2.8 has a flag; from 2.9 on a string, and reading the flag fails if the string was set.
    if hasattr(products, "fp32_precision"):
        return [products, convolutions.conv], "fp32_precision", "tf32" if tf32 else "ieee"
    return [products, convolutions], "allow_tf32", tf32


class TorchEncoder:
    """`Encoder` on a torch device, for example "cpu", "cuda" or "cuda:1", in float32 regardless of torch's settings.

    device: its device, for callers with blocks on it (`encode_tensors`).
    """

    def __init__(self, weights: Weights, device: str = "cpu") -> None:
        """Copy the encoder's layers to `device`; raises RuntimeError or AssertionError if torch has no such device."""
        self.device = torch.device(device)
        matrix, bias = weights.encoder[0]
        self.chunk = _chunk(self.device, matrix.shape[1] // 8, len(bias))
        self._octants = self._tensor(octant_matrices(matrix))
        self._bias = self._tensor(bias)
        self._layers = [(self._tensor(matrix.T), self._tensor(bias)) for matrix, bias in weights.encoder[1:]]

    def __call__(self, blocks: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Codes (C, 10) float32, see `Encoder`."""
        codes: np.ndarray = self.encode_tensors(self._tensor(blocks), self._tensor(rows).long()).cpu().numpy()
        return codes

    @torch.inference_mode()
    def encode_tensors(self, blocks: Tensor, rows: Tensor) -> Tensor:
        """Codes (C, 10) float32 of corners with blocks (U, B) float32 and rows (C, 8) int64, all on the device."""
        with float32_products(self.device):
            products = (blocks @ self._octants).view(-1, len(self._bias))  # (8 U, 256)
            bags = rows * 8 + torch.arange(8, device=self.device)
            bags.masked_fill_(rows == 0, 0)  # block 0 is empty, and padding is not read
            values = functional.embedding_bag(bags, products, mode="sum", padding_idx=0)
            values += self._bias
            for matrix, bias in self._layers:
                values = torch.addmm(bias, values.relu_(), matrix)
        return values

    def _tensor(self, array: np.ndarray) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(array)).to(self.device)


def _chunk(device: torch.device, block_values: int, width: int) -> int:
    """Number of corners at once, a power of two, whose blocks, cells and products fit a GPU's free memory."""
    least, most = _CHUNKS
    if device.type != "cuda":
        return least
    free, _ = torch.cuda.mem_get_info(device)
    needed = 4 * block_values + 4 * 8 * width + 16 * block_values + 8192  # bytes per corner, with about one block each
    fitting = max(int(free) // _MEMORY_SHARE // needed, 1)
    return min(max(1 << (fitting.bit_length() - 1), least), most)
