# SPDX-License-Identifier: GPL-3.0-or-later
"""Training batch as tensors on a device."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ...patchnet_addon.network.devices import CPU
from .batches import Batch
from .nearby import Nearby


def tensor_batch(batch: Batch, device: torch.device | str = CPU) -> Batch:
    """Batch of tensors on a device; on the CPU without a copy."""
    device = torch.device(device)

    def there(array: np.ndarray) -> Tensor:
        tensor = torch.from_numpy(array)
        return tensor if device.type == CPU else tensor.pin_memory().to(device, non_blocking=True)

    arrays = {name: there(array) for name, array in vars(batch).items() if name != "nearby"}
    return Batch(**arrays, nearby=batch.nearby and Nearby(*map(there, batch.nearby)))
