# SPDX-License-Identifier: GPL-3.0-or-later
"""Training batch as tensors on a device."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import torch
from torch import Tensor

from ...patchnet_addon.network.devices import CPU
from .batches import Batch


@dataclass(frozen=True, eq=False)
class TensorNearby:
    """Cells near V voxels in R views, see `Nearby`."""

    view: Tensor
    covered: Tensor
    luminances: Tensor


@dataclass(frozen=True, eq=False)
class TensorBatch:
    """V voxels with R views each, see `Batch`; all tensors lie on one device."""

    blocks: Tensor
    rows: Tensor
    entry: Tensor
    direction: Tensor
    up: Tensor
    ratio: Tensor
    coverage: Tensor
    luminance: Tensor
    nearby: TensorNearby | None

    @classmethod
    def of(cls, batch: Batch, device: torch.device | str = CPU) -> TensorBatch:
        """Batch on a device; on the CPU the same memory."""
        device = torch.device(device)
        near = None if batch.nearby is None else TensorNearby(**_tensors(batch.nearby, device))
        return cls(**_tensors(batch, device), nearby=near)


def _tensors(arrays: object, device: torch.device) -> dict[str, Tensor]:
    """Arrays of a dataclass on a device, by name."""
    found = {field.name: getattr(arrays, field.name) for field in fields(arrays)}  # type: ignore[arg-type]
    return {name: _tensor(array, device) for name, array in found.items() if isinstance(array, np.ndarray)}


def _tensor(array: np.ndarray, device: torch.device) -> Tensor:
    tensor = torch.from_numpy(array)
    return tensor if device.type == CPU else tensor.pin_memory().to(device, non_blocking=True)
