# SPDX-License-Identifier: GPL-3.0-or-later
"""Processes that train together, on one machine or several: each computes a share of every step (data parallel).

`torchrun` starts them and sets variables with their ranks. Gradients of all shares are summed before each step, so that
the result is the same for any number of processes up to rounding. All processes read files, the first one writes.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, distributed

from ...patchnet_addon.runtime.errors import SettingError


@dataclass(frozen=True)
class Processes:
    """Processes of a run. rank: number of this one. count: of all."""

    rank: int = 0
    count: int = 1

    @classmethod
    def joined(cls) -> Processes:
        """Join the processes that torchrun started, else a single one; raises SettingError for invalid variables."""
        try:
            rank, count = int(os.environ.get("RANK", "0")), int(os.environ.get("WORLD_SIZE", "1"))
            if not 0 <= rank < count:
                raise ValueError(f"RANK {rank} is outside WORLD_SIZE {count}")
            if count > 1 and not distributed.is_initialized():
                distributed.init_process_group("gloo")
        except (ValueError, RuntimeError) as cause:  # RuntimeError: no connection between processes
            reason = str(cause).splitlines()[0]
            raise SettingError(
                f"Processes cannot train together ({reason}): start them with torchrun, or unset RANK and WORLD_SIZE"
            ) from cause
        return cls(rank, count)

    @property
    def is_first(self) -> bool:
        """Whether this process writes the files."""
        return self.rank == 0

    def part(self, length: int) -> slice:
        """This process's share of `length` items."""
        return slice(self.rank * length // self.count, (self.rank + 1) * length // self.count)

    def sums(self, tensors: Sequence[Tensor]) -> list[Tensor]:
        """Sums of float32 tensors over all processes."""
        if self.count == 1:
            return list(tensors)
        flat = torch.cat([tensor.flatten() for tensor in tensors]).cpu()
        distributed.all_reduce(flat)
        parts = flat.split([tensor.numel() for tensor in tensors])
        return [part.view_as(tensor).to(tensor.device) for part, tensor in zip(parts, tensors, strict=True)]

    def leave(self) -> None:
        """Leave the group, after all processes have arrived here."""
        if self.count > 1 and distributed.is_initialized():
            distributed.barrier()
            distributed.destroy_process_group()
