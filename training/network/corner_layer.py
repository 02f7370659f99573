# SPDX-License-Identifier: GPL-3.0-or-later
"""First layer of the encoder on the occupied blocks of a batch: exact, and about half the work or less.

A corner's patch is eight blocks (4x4x4 cells for a look-ahead of two levels), most of them often empty. The layer is
linear, so each occupied block is multiplied with the slice of the matrix that belongs to its octant, and the products
are added up per corner.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ...patchnet_addon.network.encoders import CHANNELS, LUMINANCE

SLICES = 8  # octants of a corner's patch
SHAPE = [channel for channel in range(CHANNELS) if channel != LUMINANCE]  # what says how a cell is shaped


class BlockPairs(NamedTuple):
    """Occupied blocks of a batch, and which of them meets which slice for which corner, see `Batch`.

    blocks: (M, B). starts: 9 numbers. block, corner: (P,). corners: how many there are.
    """

    blocks: Tensor
    starts: list[int]
    block: Tensor
    corner: Tensor
    corners: int


def to_slices(weight: Tensor, *, shape_alone: bool = False) -> Tensor:
    """Matrix (out, 8 B) of a patch in the order z, y, x, channel as slices (8, B, out), one per octant.

    shape_alone: without the rows of luminance, for encoders that do not see it.
    """
    out, size = weight.shape
    side = round((size // SLICES // CHANNELS) ** (1 / 3))
    # (out, octant z, cell z, octant y, cell y, octant x, cell x, channel)
    eight = weight.view(out, 2, side, 2, side, 2, side, CHANNELS)
    if shape_alone:
        eight = eight[..., SHAPE]
    return eight.permute(1, 3, 5, 2, 4, 6, 7, 0).reshape(SLICES, -1, out)


def from_slices(slices: Tensor, *, shape_alone: bool = False) -> Tensor:
    """Inverse of `to_slices`; what an encoder does not see is multiplied by 0."""
    if shape_alone:
        slices = with_luminance(slices.transpose(1, 2)).transpose(1, 2)
    size, out = slices.shape[1:]
    side = round((size // CHANNELS) ** (1 / 3))
    eight = slices.reshape(2, 2, 2, side, side, side, CHANNELS, out)
    return eight.permute(7, 0, 3, 1, 4, 2, 5, 6).reshape(out, SLICES * size)


def with_luminance(blocks: Tensor) -> Tensor:
    """Blocks (..., 5 n) of cells, with luminances of 0, of blocks (..., 4 n) that have none."""
    cells = blocks.unflatten(-1, (-1, len(SHAPE)))
    result = cells.new_zeros(*cells.shape[:-1], CHANNELS)
    result[..., SHAPE] = cells
    return result.flatten(-2)


def corner_sums(slices: Tensor, blocks: Tensor, pair_block: Tensor, pair_corner: Tensor, corners: int) -> Tensor:
    """Sum over a corner's occupied blocks of block x slice (corners, out) float32, of pairs as in `PaddedBatch`.

    slices: (8, B, out) float32; products are of the type of `blocks`.
    """
    products = torch.bmm(blocks[pair_block], slices.to(blocks.dtype)).float()  # (8, N, out)
    result = products.new_zeros(corners + 1, products.shape[2])  # the last row is of pairs of nothing
    return result.index_add(0, pair_corner.flatten(), products.flatten(0, 1))[:corners]
