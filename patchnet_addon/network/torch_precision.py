# SPDX-License-Identifier: GPL-3.0-or-later
"""Precision of float32 products on a GPU; imports nothing of the package, as another Python may run it on its own."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch


@contextmanager
def float32_products(device: torch.device, *, tf32: bool = False) -> Iterator[None]:
    """Products of float32 on a GPU are exact float32 within the block, or TF32 (10 bits of mantissa) if that is wanted.

    Whatever the process or its environment had chosen (TORCH_ALLOW_TF32_CUBLAS_OVERRIDE is set in NVIDIA's images)
    holds again afterwards. Nothing changes on a CPU.
    """
    if device.type != "cuda":
        yield
        return
    matmul = torch.backends.cuda.matmul
    # torch up to 2.8 has a switch; from 2.9 on a word, and reading the switch is an error where the word was set.
    has_word = hasattr(matmul, "fp32_precision")
    name, wanted = ("fp32_precision", "tf32" if tf32 else "ieee") if has_word else ("allow_tf32", tf32)
    before = getattr(matmul, name)
    setattr(matmul, name, wanted)
    try:
        yield
    finally:
        setattr(matmul, name, before)
