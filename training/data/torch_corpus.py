# SPDX-License-Identifier: GPL-3.0-or-later
"""Corpus on a GPU: octrees and samples lie there, and batches are gathered there; `batches.py` on the CPU in torch."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ...patchnet_addon.codes.torch_tree import NODE_BYTES, TorchTree
from ...patchnet_addon.network.torch_copy import to_device
from ...patchnet_addon.network.weights import CHANNELS
from ...patchnet_addon.octree.octree import LUMINANCE_SCALE, NORMAL_SCALE
from .batches import PAIR_POSITION, Augmentation
from .corpus import Corpus
from .samples import COVERAGE_SCALE, SIGNED, UNIT
from .symmetry import cube_symmetries
from .tensor_batch import TensorBatch

_BLOCKS = 27


def corpus_fits(corpus: Corpus, device: torch.device) -> bool:
    """Return whether octrees and samples take at most half of a GPU's free memory."""
    free, _ = torch.cuda.mem_get_info(device)
    return 2 * (NODE_BYTES * len(corpus.forest.luminance) + corpus.views.nbytes + 2 * corpus.voxel.nbytes) <= int(free)


class TorchCorpus:
    """Copy of a corpus on a torch device."""

    def __init__(self, corpus: Corpus, device: torch.device) -> None:
        self.device, self._lookahead = device, corpus.lookahead
        self._tree = TorchTree(corpus.forest, device)
        self._deepest = int(corpus.voxel[:, 0].max(initial=0))
        self._root = to_device(corpus.forest.root[corpus.tree], device)  # (G,)
        self._voxel = to_device(corpus.voxel, device)  # (G, 4) int16, bits of uint16
        self._views = to_device(corpus.views, device)  # (G, R, 12) int16, bits of uint16
        symmetries = cube_symmetries(corpus.lookahead)
        self._axis, self._sign = (to_device(table, device) for table in (symmetries.axis, symmetries.sign))
        self._axis = self._axis.long()
        self._block = to_device(symmetries.block, device).long()  # (48, 27)
        self._source = to_device(np.argsort(symmetries.cell, axis=1), device)  # (48, 8^n) cell that comes to each
        position = np.arange(_BLOCKS)
        offsets = np.stack([position % 3, position // 3 % 3, position // 9], axis=-1) - 1
        self._offsets = to_device(offsets, device)  # (27, 3)
        self._pairs = to_device(PAIR_POSITION, device).long()  # (8, 8)

    @torch.no_grad()
    def batch(self, rows: np.ndarray, augmentation: Augmentation) -> TensorBatch:
        """Batch of the voxels `rows` (V,), the same as `Corpus.batch` gives but for rounding."""
        chosen = self._there(rows)
        symmetry, remap = self._there(augmentation.symmetry).long(), self._there(augmentation.remap)
        voxel = self._voxel[chosen].long() & 0xFFFF
        count = len(rows)
        level = voxel[:, :1].expand(-1, _BLOCKS).reshape(-1)
        cells = (voxel[:, None, 1:] + self._offsets).view(-1, 3)
        root = self._root[chosen][:, None].expand(-1, _BLOCKS).reshape(-1)
        node = self._tree.covering(self._deepest, cells, root, own_level=level)  # (27 V,)
        occupied = (node >= 0).nonzero()[:, 0]  # (M,)
        owner = occupied // _BLOCKS  # (M,)
        turn = symmetry[owner]
        fine = self._tree.fine_cells(node[occupied], self._lookahead)
        linear = self._linear(fine, owner, remap)
        blocks = self._blocks(fine.gather(1, self._source[turn]), turn, linear[owner])
        moved = torch.full((count, _BLOCKS), -1, device=self.device)
        moved[owner, self._block[turn, occupied % _BLOCKS]] = torch.arange(len(occupied), device=self.device)
        return TensorBatch(blocks, *self._list_pairs(moved), *self._move_views(chosen, symmetry, linear))

    def _there(self, array: np.ndarray) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(array)).to(self.device)

    def _linear(self, fine: Tensor, owner: Tensor, remap: Tensor) -> Tensor:
        """Gain and offset (V, 2) float32 of luminance by `remap` (V, 4), see `Augmentation`."""
        value = self._tree.luminance[fine.clamp(min=0)].int() & 0xFFFF  # (M, 8^n)
        low = value.masked_fill(fine < 0, 65535).amin(1)
        high = value.masked_fill(fine < 0, 0).amax(1)
        darkest = torch.full((len(remap),), 65535, dtype=low.dtype, device=self.device)
        darkest = darkest.scatter_reduce(0, owner, low, "amin")
        brightest = torch.zeros_like(darkest).scatter_reduce(0, owner, high, "amax")
        dark, bright = darkest.double() / LUMINANCE_SCALE, brightest.double() / LUMINANCE_SCALE
        wanted = remap.double()
        gain = torch.minimum(wanted[:, 0], 1.0 / (bright - dark).clamp(min=1e-6))
        place = wanted[:, 1] * (1.0 - gain * (bright - dark))
        inverted = remap[:, 2] > 0
        linear = torch.stack(
            [torch.where(inverted, -gain, gain), torch.where(inverted, place + gain * bright, place - gain * dark)], 1
        )
        left = torch.tensor([1.0, 0.0], dtype=linear.dtype, device=self.device)
        return torch.where(remap[:, 3:] == 0, left, linear).float()

    def _blocks(self, fine: Tensor, turn: Tensor, linear: Tensor) -> Tensor:
        """Blocks (M, B) float32 of cells (M, 8^n) that are in their new places already."""
        there, safe = fine >= 0, fine.clamp(min=0)
        gain, offset = linear[:, :1] / LUMINANCE_SCALE, linear[:, 1:]
        luminance = gain * (self._tree.luminance[safe].int() & 0xFFFF) + offset
        axis = self._axis[turn][:, None].expand(-1, fine.shape[1], -1)
        normal = self._tree.normal[safe].float().gather(2, axis) * (self._sign[turn] / NORMAL_SCALE)[:, None]
        values = torch.cat([self._tree.filled(safe)[..., None], luminance[..., None], normal], dim=-1)
        return values.masked_fill_(~there[..., None], 0.0).view(len(fine), CHANNELS * fine.shape[1])

    def _list_pairs(self, moved: Tensor) -> tuple[list[int], Tensor, Tensor]:
        """Starts of slices, blocks and corners of pairs for rows of blocks (V, 27) by position, -1 for none."""
        met = moved[:, self._pairs].permute(1, 0, 2).reshape(8, -1)  # slice; voxel and corner
        counts = (met >= 0).sum(1)
        starts = [0, *counts.cumsum(0).tolist()]
        places = (met >= 0).nonzero()
        return starts, met[places[:, 0], places[:, 1]], places[:, 1].contiguous()

    def _move_views(self, chosen: Tensor, symmetry: Tensor, linear: Tensor) -> tuple[Tensor, ...]:
        """Entry, direction, up, ratio, coverage, luminance of stored views after the augmentation."""
        views = self._views[chosen]  # (V, R, 12)
        unit = (views.int() & 0xFFFF).float() / UNIT
        signed = views[..., 3:9].float() / SIGNED
        axis = self._axis[symmetry][:, None].expand(-1, views.shape[1], -1)
        sign = self._sign[symmetry][:, None]
        entry = sign * (unit[..., :3] - 0.5).gather(2, axis) + 0.5
        direction, up = (sign * part.gather(2, axis) for part in (signed[..., :3], signed[..., 3:]))
        coverage = (views[..., 10].int() & 0xFFFF).float() / COVERAGE_SCALE
        luminance = unit[..., 11] * linear[:, None, 0] + linear[:, None, 1]
        return entry, direction, up, unit[..., 9].contiguous(), coverage, luminance
