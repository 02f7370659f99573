# SPDX-License-Identifier: GPL-3.0-or-later
"""Precision of float32 products and convolutions on a GPU."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import torch


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
