# SPDX-License-Identifier: GPL-3.0-or-later
"""Octree on a torch device: blocks of voxels by gathers, the counterpart of `brick.py`.

Encoding on a GPU is too fast for one core to gather its blocks.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ..cells.leaf_boxes import FILLED_STEPS
from ..cells.morton import POPCOUNT
from ..cells.scales import LUMINANCE_SCALE, NORMAL_SCALE
from ..network.torch_encode import TorchEncoder
from ..octree.octree import Octree
from .brick import OCTANTS

_SIGNED = {np.dtype(np.uint16): np.int16, np.dtype(np.uint32): np.int32}  # torch has few operations for unsigned types


class TorchTree:
    """Copy of an octree's node arrays on a torch device; nodes are int64 tensors there, -1 for none."""

    def __init__(self, octree: Octree, device: torch.device) -> None:
        self.device = device
        self._luminance = to_device(octree.luminance, device)  # (n,) int16, bits of uint16
        self._normal = to_device(octree.normal, device)  # (n, 3) int8
        self._filled = to_device(octree.filled, device)  # (n,) int16
        self._child_mask = to_device(octree.child_mask, device)  # (n,) uint8
        self._first_child = to_device(octree.first_child, device)  # (n,) int32
        masks, octants = np.arange(256)[:, None], np.arange(8)
        place = POPCOUNT[masks & ((1 << octants) - 1)].astype(np.int64)  # among the children that exist
        self._place = to_device(np.where(masks >> octants & 1, place, -1), device)  # (256, 8), -1 for no child
        # As tensors, since a GPU multiplies by the reciprocal of a host number, which changes the last digit.
        scales = (LUMINANCE_SCALE, NORMAL_SCALE, FILLED_STEPS)
        self._scales = tuple(torch.tensor(float(scale), device=device) for scale in scales)

    def covering(self, level: int, cells: Tensor) -> Tensor:
        """Node (N,) at each cell (N, 3) of a level, the coarser leaf that covers it, or -1; cells may lie outside."""
        x, y, z = cells.unbind(-1)
        inside = ((cells >= 0) & (cells < 1 << level)).all(-1)
        node = inside.long() - 1  # the root, or none
        for shift in range(level - 1, -1, -1):
            octant = (x >> shift & 1) | (y >> shift & 1) << 1 | (z >> shift & 1) << 2
            mask, below = self._children(node)
            stays = (mask == 0) | (node < 0)
            node = torch.where(stays, node, below.gather(-1, octant[:, None]).squeeze(-1))
        return node

    def fine_cells(self, nodes: Tensor, lookahead: int) -> Tensor:
        """Nodes (M, 8^n) of the cells n = `lookahead` levels below `nodes` (M,), order z, y, x, -1 for empty ones.

        A coarser leaf fills its part of the block, see `fill_block`.
        """
        cells = nodes[:, None]
        for _ in range(lookahead):
            mask, below = self._children(cells)
            stays = (mask == 0) | (cells < 0)
            cells = torch.where(stays[..., None], cells[..., None], below).flatten(1)
        return cells[:, torch.from_numpy(paths(lookahead)).to(self.device)]

    def values(self, cells: Tensor) -> Tensor:
        """Occupancy, luminance and normal (..., 5) float32 of cells (...,); zeros for empty ones."""
        there, safe = cells >= 0, cells.clamp(min=0)
        white, unit, full = self._scales
        filled = self._filled[safe].float() / full
        luminance = (self._luminance[safe].int() & 0xFFFF).float() / white
        normal = self._normal[safe].float() / unit
        values = torch.cat([filled[..., None], luminance[..., None], normal], dim=-1)
        return values.masked_fill_(~there[..., None], 0.0)

    def _children(self, nodes: Tensor) -> tuple[Tensor, Tensor]:
        """Child masks (...,) and children (..., 8), -1 for none, of nodes (...,); undefined for node -1."""
        safe = nodes.clamp(min=0)
        mask = self._child_mask[safe].int()
        place = self._place[mask]
        first = self._first_child[safe].long()[..., None]
        return mask, torch.where(place >= 0, first + place, -1)


class TorchCorners:
    """Encoder of the corners of an octree whose nodes and blocks are on the encoder's device."""

    def __init__(self, encoder: TorchEncoder, octree: Octree, lookahead: int) -> None:
        self._encoder, self._lookahead = encoder, lookahead
        self._tree = TorchTree(octree, encoder.device)

    @torch.inference_mode()
    def __call__(self, level: int, corners: np.ndarray) -> np.ndarray:
        """Codes (C, 10) float32 of corners (C, 3) of a level; each voxel around them is read once."""
        device = self._encoder.device
        cells = torch.from_numpy(corners.astype(np.int64)).to(device)[:, None] - 1
        cells = (cells + torch.from_numpy(OCTANTS.astype(np.int64)).to(device)).view(-1, 3)
        found = torch.cat([self._tree.covering(level, cells), torch.full((1,), -1, device=device)])
        nodes, rows = torch.unique(found, return_inverse=True)  # node -1 comes first
        fine = self._tree.fine_cells(nodes, self._lookahead)
        blocks = self._tree.values(fine).view(len(nodes), -1)
        codes: np.ndarray = self._encoder.encode_tensors(blocks, rows[:-1].view(-1, 8)).cpu().numpy()
        return codes


def paths(lookahead: int) -> np.ndarray:
    """Place (8^n,) int64 of each cell of a block, order z, y, x, if n = `lookahead` octants are read one by one."""
    side = 1 << lookahead
    z, y, x = np.unravel_index(np.arange(side**3), (side,) * 3)
    place = np.zeros(side**3, np.int64)
    for bit in range(lookahead - 1, -1, -1):
        place = 8 * place + ((x >> bit & 1) | (y >> bit & 1) << 1 | (z >> bit & 1) << 2)
    return place


def to_device(array: np.ndarray, device: torch.device) -> Tensor:
    """Copy of an array (n, ...) on a device; uint16 and uint32 keep their bits as int16 and int32."""
    signed = array.view(_SIGNED.get(array.dtype, array.dtype))
    return torch.from_numpy(np.array(signed, order="C")).to(device)
