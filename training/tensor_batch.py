# SPDX-License-Identifier: GPL-3.0-or-later
"""Training batch as tensors on a device: what a `Batch` of arrays becomes, or what `torch_corpus.py` gathers there."""

from __future__ import annotations

from dataclasses import dataclass, fields

import torch
from torch import Tensor

from .batches import Batch


@dataclass(frozen=True, eq=False)
class TensorBatch:
    """V voxels with R views each, see `Batch`; all tensors lie on one device.

    slice_start: 9 numbers, on the host, since they bound slices.
    """

    blocks: Tensor
    slice_start: list[int]
    pair_block: Tensor
    pair_corner: Tensor
    entry: Tensor
    direction: Tensor
    up: Tensor
    ratio: Tensor
    coverage: Tensor
    luminance: Tensor

    @classmethod
    def of(cls, batch: Batch, device: torch.device) -> TensorBatch:
        """Tensors of a batch's arrays: the same memory on the CPU, copies by way of pinned memory on a GPU."""
        arrays = {field.name: getattr(batch, field.name) for field in fields(cls)}
        starts = arrays.pop("slice_start").tolist()
        tensors = {name: torch.from_numpy(array) for name, array in arrays.items()}
        if device.type == "cuda":
            tensors = {name: value.pin_memory().to(device, non_blocking=True) for name, value in tensors.items()}
        return cls(slice_start=starts, **tensors)
