# SPDX-License-Identifier: GPL-3.0-or-later
"""Training batch as tensors on a device."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import torch
from torch import Tensor

from ...patchnet_addon.network.devices import CPU
from .batches import Batch, BatchOf
from .nearby import NearbyOf

TensorBatch = BatchOf[Tensor]
TensorNearby = NearbyOf[Tensor]


def tensor_batch(batch: Batch, device: torch.device | str = CPU) -> TensorBatch:
    """Batch on a device; on the CPU without a copy."""
    device = torch.device(device)
    near = None if batch.nearby is None else TensorNearby(**_tensors(batch.nearby, device))
    return TensorBatch(**_tensors(batch, device), nearby=near)


def _tensors(arrays: object, device: torch.device) -> dict[str, Tensor]:
    """Arrays of a dataclass on a device, by name."""
    found = {field.name: getattr(arrays, field.name) for field in fields(arrays)}  # type: ignore[arg-type]
    return {name: _tensor(array, device) for name, array in found.items() if isinstance(array, np.ndarray)}


def _tensor(array: np.ndarray, device: torch.device) -> Tensor:
    tensor = torch.from_numpy(array)
    return tensor if device.type == CPU else tensor.pin_memory().to(device, non_blocking=True)
