# SPDX-License-Identifier: GPL-3.0-or-later
"""Copies of large arrays on a torch device; arrays that are mapped from files are read part by part."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

_PART_BYTES = 1 << 26
_SIGNED = {np.dtype(np.uint16): np.int16, np.dtype(np.uint32): np.int32}  # torch does little with unsigned ones


def to_device(array: np.ndarray, device: torch.device) -> Tensor:
    """Copy of an array (n, ...) on a device; uint16 and uint32 keep their bits as int16 and int32."""
    array = array.view(_SIGNED.get(array.dtype, array.dtype))
    first = torch.from_numpy(np.array(array[:0]))
    result = torch.empty(array.shape, dtype=first.dtype, device=device)
    rows = max(1, _PART_BYTES // max(array[:1].nbytes, 1))
    for start in range(0, len(array), rows):
        result[start : start + rows] = torch.from_numpy(np.array(array[start : start + rows], order="C"))
    return result
