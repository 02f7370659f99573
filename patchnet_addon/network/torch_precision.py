# SPDX-License-Identifier: GPL-3.0-or-later
"""Precision of float32 products and convolutions on a GPU."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import torch


@contextmanager
def float32_products(device: torch.device, *, tf32: bool = False) -> Iterator[None]:
    """Products and convolutions of float32 on a GPU are exact float32 within the block, or TF32 if that is wanted.

    TF32 has 10 bits of mantissa; torch convolves in it unless it is told otherwise. Whatever the process or its
    environment had chosen (TORCH_ALLOW_TF32_CUBLAS_OVERRIDE is set in NVIDIA's images) holds again afterwards. Nothing
    changes on a CPU.
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
    """What holds the precision of products and of convolutions, what it is called there, and the wanted value."""
    products: Any = torch.backends.cuda.matmul
    convolutions: Any = torch.backends.cudnn
    # torch up to 2.8 has a switch; from 2.9 on a word, and reading the switch is an error where the word was set.
    if hasattr(products, "fp32_precision"):
        return [products, convolutions.conv], "fp32_precision", "tf32" if tf32 else "ieee"
    return [products, convolutions], "allow_tf32", tf32
