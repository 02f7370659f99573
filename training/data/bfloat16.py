# SPDX-License-Identifier: GPL-3.0-or-later
"""Bits of bfloat16 as uint16, which NumPy and numba have no type for: to float32 and back, in kernels."""

from __future__ import annotations

import numpy as np

from ...patchnet_addon.runtime.kernels import device


@device
def wide_value(bits):
    """Float32 of the bits of a bfloat16."""
    return np.uint32(np.uint32(bits) << np.uint32(16)).view(np.float32)


@device
def narrow_bits(value):
    """Bits of the bfloat16 nearest to a finite float32, of two that are as near the even one, as uint16."""
    whole = np.float32(value).view(np.uint32)
    return np.uint16(np.uint32(whole + np.uint32(0x7FFF) + ((whole >> np.uint32(16)) & np.uint32(1))) >> np.uint32(16))
