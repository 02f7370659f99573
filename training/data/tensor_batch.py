# SPDX-License-Identifier: GPL-3.0-or-later
"""Training batch as tensors on a device."""

from __future__ import annotations

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
    found = {name: torch.from_numpy(array) for name, array in vars(arrays).items() if isinstance(array, np.ndarray)}
    if device.type == CPU:
        return found
    return {name: tensor.pin_memory().to(device, non_blocking=True) for name, tensor in found.items()}
