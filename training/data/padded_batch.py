# SPDX-License-Identifier: GPL-3.0-or-later
"""Training batches of one shape, whichever blocks are occupied, each in one piece of memory.

So that a GPU is given a batch by one copy, and finds every array where that of the batch before lay: what it does with
them can be recorded once (`training/network/replayed.py`).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from ...patchnet_addon.network.devices import CPU
from ...patchnet_addon.network.kinds import COVERING, MIXED, VIEW
from .batches import Batch
from .nearby import Nearby
from .tensor_batch import TensorBatch, TensorNearby

_ALIGNED = 64  # bytes
_BLOCKS = 27  # around a voxel
_SLICES = 8


@dataclass(frozen=True, eq=False)
class PaddedBatch(TensorBatch):
    """Batch whose slices all meet as many pairs, N, the last of them of nothing.

    blocks: (27 V + 1, B), whose first row is zeros; what lies behind the occupied ones is not read. pair_block: (8, N)
    rows of `blocks`, 0 for nothing. pair_corner: (8, N), 8 V for nothing. slice_start is empty.
    """

    @classmethod
    def of(cls, batch: Batch, device: torch.device | str = CPU) -> PaddedBatch:
        """Copy of a batch on a device, alone."""
        voxels, views = batch.ratio.shape
        layout = BatchLayout(voxels, views, batch.blocks.shape[1], batch.nearby is not None)
        memory = np.empty(layout.size, np.uint8)
        _, pairs = layout.write(batch, memory)
        return layout.read(torch.from_numpy(memory).to(device), pairs)


class _Place(NamedTuple):
    """Place of an array: number type, shape, bytes from the beginning of the memory."""

    dtype: type
    shape: tuple[int, ...]
    offset: int

    @property
    def size(self) -> int:
        """Bytes."""
        return int(np.prod(self.shape)) * np.dtype(self.dtype).itemsize


@dataclass(frozen=True)
class BatchLayout:
    """Layout of batches of so many voxels with so many views each, as `Batch` describes them.

    values: of a block. nearby: with the luminances that a mixture needs.
    """

    voxels: int
    views: int
    values: int
    nearby: bool

    @cached_property
    def _places(self) -> dict[str, _Place]:
        rays = self.voxels, self.views
        shapes: dict[str, tuple[type, tuple[int, ...]]] = {}
        shapes |= dict.fromkeys(("entry", "direction", "up"), (np.float32, (*rays, 3)))
        shapes |= dict.fromkeys(("ratio", "coverage", "luminance"), (np.float32, rays))
        if self.nearby:
            sizes = zip(fields(Nearby), (VIEW, COVERING, MIXED), strict=True)
            shapes |= {field.name: (np.float32, (*rays, size)) for field, size in sizes}
        shapes |= dict.fromkeys(("pair_block", "pair_corner"), (np.int64, (_SLICES, 8 * self.voxels)))
        # Last, for of them only those that are occupied are copied.
        shapes["blocks"] = np.float32, (_BLOCKS * self.voxels + 1, self.values)
        places, offset = {}, 0
        for name, (dtype, shape) in shapes.items():
            places[name] = _Place(dtype, shape, offset)
            offset += -(-places[name].size // _ALIGNED) * _ALIGNED
        return places

    @property
    def size(self) -> int:
        """Bytes of a batch whose blocks are all occupied."""
        last = self._places["blocks"]
        return last.offset + last.size

    def write(self, batch: Batch, memory: np.ndarray) -> tuple[int, int]:
        """Write a batch into memory (size,) uint8; returns how many bytes it takes, and pairs N of a slice.

        N is a multiple of the number of voxels, so that batches have few shapes.
        """
        arrays: dict[str, np.ndarray] = {
            name: memory[place.offset : place.offset + place.size].view(place.dtype).reshape(place.shape)
            for name, place in self._places.items()
        }
        for name in ("entry", "direction", "up", "ratio", "coverage", "luminance"):
            arrays[name][...] = getattr(batch, name)
        for field in fields(Nearby) if self.nearby else ():
            arrays[field.name][...] = getattr(batch.nearby, field.name)
        most = int(np.diff(batch.slice_start).max())
        pairs = max(1, -(-most // self.voxels)) * self.voxels
        for number, (first, last) in enumerate(itertools.pairwise(batch.slice_start)):
            block, corner, count = arrays["pair_block"][number], arrays["pair_corner"][number], last - first
            block[:count] = batch.pair_block[first:last] + 1
            corner[:count] = batch.pair_corner[first:last]
            block[count:pairs], corner[count:pairs] = 0, 8 * self.voxels
        rows = 1 + len(batch.blocks)
        arrays["blocks"][0] = 0
        arrays["blocks"][1:rows] = batch.blocks
        return self._places["blocks"].offset + arrays["blocks"][:rows].nbytes, pairs

    def read(self, memory: Tensor, pairs: int) -> PaddedBatch:
        """Batch that lies in memory (size,) uint8, with `pairs` N of a slice; the same memory."""
        found: dict[str, Any] = {
            name: memory[place.offset : place.offset + place.size].view(_TORCH[place.dtype]).view(place.shape)
            for name, place in self._places.items()
        }
        for name in ("pair_block", "pair_corner"):
            found[name] = found[name][:, :pairs]
        near = {field.name: found.pop(field.name) for field in fields(Nearby) if self.nearby}
        return PaddedBatch(slice_start=[], nearby=TensorNearby(**near) if near else None, **found)


_TORCH: dict[type, torch.dtype] = {np.float32: torch.float32, np.int64: torch.int64}
