# SPDX-License-Identifier: GPL-3.0-or-later
"""Training runs: steps on threads and GPUs, validation, checkpoints, logs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """Limit torch's threads within operations to a number inside the block."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)
