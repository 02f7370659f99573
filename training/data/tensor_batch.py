# SPDX-License-Identifier: GPL-3.0-or-later
"""Training batch as tensors: the arrays of a `Batch` on the CPU, and what `padded_batch.py` makes of them for a GPU."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np
import torch
from torch import Tensor

from .batches import Batch


@dataclass(frozen=True, eq=False)
class TensorNearby:
    """Cells near V voxels in R views, see `Nearby`."""

    view: Tensor
    covered: Tensor
    luminances: Tensor


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
    nearby: TensorNearby | None = field(default=None, kw_only=True)

    @classmethod
    def of(cls, batch: Batch) -> TensorBatch:
        """Tensors of a batch's arrays, the same memory."""
        arrays = {each.name: getattr(batch, each.name) for each in fields(cls)}
        starts, nearby = arrays.pop("slice_start").tolist(), arrays.pop("nearby")
        there = None
        if nearby is not None:
            there = TensorNearby(**{each.name: _tensor_of(getattr(nearby, each.name)) for each in fields(nearby)})
        return cls(slice_start=starts, nearby=there, **{name: _tensor_of(array) for name, array in arrays.items()})


def _tensor_of(array: np.ndarray) -> Tensor:
    """The same memory as a tensor; uint16 is the bits of bfloat16."""
    if array.dtype == np.uint16:
        return torch.from_numpy(array.view(np.int16)).view(torch.bfloat16)
    return torch.from_numpy(array)
