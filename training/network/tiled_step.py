# SPDX-License-Identifier: GPL-3.0-or-later
"""Gradients of a part of a training step in matrix units, by one kernel from its batch to the gradient.

What autograd and a kernel for each layer's direction do, without Python in between: after each kernel the interpreter's
own code is in no cache any more, so that a hundred of its steps take as long as a tenth of the part, and threads that
learn side by side wait for its lock.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from ...patchnet_addon.network.kinds import CODE_SIZE, CORNERS, NetworkKind
from ...patchnet_addon.network.lanes import LANES
from ...patchnet_addon.runtime.aligned_memory import aligned, aligned_bits, aligned_floats
from ...patchnet_addon.runtime.kernels import device, kernel
from ..data.batches import Batch
from .corner_layer import SLICES
from .decoder_kernels import decode_views, differentiate_views
from .decoder_products import ROWS, filled
from .flat_memory import (
    DECODER_LAYERS,
    MIDDLE,
    Sizes,
    bias_part,
    decoder_parts,
    flat_memory,
    last_parts,
    middle_parts,
    slices_part,
)
from .losses import measure_errors
from .matrix_units import SIDE, matrix_units_usable
from .tiled_backward import differentiate_groups
from .tiled_forward import encode_groups
from .tiled_packing import PackedMatrices

_NONE = np.empty((0, 0, 0), np.float32)  # what is near, for networks that do not see it


def fits(slices: Tensor) -> bool:
    """Whether a network with such slices (8, B, width) can be multiplied in matrix units here."""
    return slices.shape[1] % SIDE == 0 and matrix_units_usable()


def sizes_of(slices: Tensor, kind: NetworkKind) -> Sizes:
    """Sizes of a network with such slices (8, B, width)."""
    return Sizes(slices.shape[1], slices.shape[2], CODE_SIZE, np.array(kind.decoder))


class TiledStep:
    """Gradients of a network's loss, by its parameters in the order of `SlicedNet.trained`.

    squared, luminance_weight: of the loss, see `loss_gradient`. Products of the encoder in bfloat16 with float32 sums,
    those of codes right to float32, those of the decoder float32.
    """

    def __init__(self, parameters: Sequence[Tensor], sizes: Sizes, *, squared: bool, luminance_weight: float) -> None:
        self.packed = PackedMatrices(parameters, sizes)
        self._flat = flat_memory(parameters).numpy()
        self._sizes, self._loss = sizes, (squared, np.float32(luminance_weight))

    def gradients(self, batch: Batch, share: float = 1.0) -> tuple[Tensor, Tensor]:
        """Gradient (n,) of the loss of a batch whose blocks are bits of bfloat16, and sums (3,): see `Learner`."""
        gradient = aligned(self._flat.shape, np.float32)
        near = batch.nearby
        beside = (near.view, near.covered, near.luminances) if near else (_NONE, _NONE, _NONE)
        sums = _learn(
            (batch.blocks, batch.slice_start, batch.pair_block, batch.pair_corner),
            (batch.entry, batch.direction, batch.up, batch.ratio),
            beside,
            (batch.coverage, batch.luminance),
            (self._flat, self.packed.current(), self._sizes),
            (*self._loss, np.float32(share)),
            gradient,
        )
        return torch.from_numpy(gradient), torch.from_numpy(sums)


@kernel
def _learn(blocks, rays, near, wanted, parameters, loss, gradient):  # type: ignore[no-untyped-def]
    """Write the gradient of the loss; returns sums (3,) float32 of its errors."""
    bits, starts, pair_block, pair_corner = blocks
    flat, packed, sizes = parameters
    squared, luminance_weight, share = loss
    coverage, luminance = wanted
    voxels, views = coverage.shape
    corners, width = CORNERS * voxels, sizes.width
    lines = (corners + SIDE - 1) // SIDE * SIDE

    groups = np.empty(lines, np.int32), np.empty((lines, SLICES), np.int32), np.empty(lines // SIDE, np.int32)
    hidden = aligned_bits((MIDDLE + 1) * lines * width).reshape((MIDDLE + 1, lines, width))
    last, of_last = last_parts(flat, sizes)
    codes = np.empty((corners, sizes.codes), np.float32)
    encoder = packed, _encoder_biases(flat, sizes), last, of_last
    encode_groups(bits, (starts, pair_block, pair_corner), encoder, groups, hidden, codes)

    entry, direction, up = _flat_rays(rays[0]), _flat_rays(rays[1]), _flat_rays(rays[2])
    view, covered, luminances = _flat_rays(near[0]), _flat_rays(near[1]), _flat_rays(near[2])
    kept, found = _empty_kept(voxels * views, sizes.decoder), np.empty((voxels, views, 2), np.float32)
    decoder, each = decoder_parts(flat, sizes), found.reshape((voxels * views, 2))
    eight = codes.reshape((voxels, CORNERS, sizes.codes))
    flat_ratio = rays[3].reshape(voxels * views)
    decode_views(eight, (entry, direction, up, flat_ratio), (view, covered), luminances, decoder, kept, each)

    of_found, sums = np.empty((voxels, views, 2), np.float32), np.zeros(3)
    measure_errors(found, coverage, luminance, squared, luminance_weight, share, of_found, sums)

    of_codes = np.empty((voxels, CORNERS, sizes.codes), np.float32)
    of_decoder = decoder_parts(gradient, sizes)
    differentiate_views(of_found.reshape((voxels * views, 2)), kept, entry, decoder[0], of_codes, of_decoder)

    of_rows = of_codes.reshape((corners, sizes.codes))
    of_biases, of_last_parts = np.zeros((MIDDLE + 1, width), np.float32), last_parts(gradient, sizes)
    parts = slices_part(gradient, sizes), middle_parts(gradient, sizes), of_biases, of_last_parts[0]
    differentiate_groups(bits, groups, (packed, last), hidden, of_rows, parts)
    for layer in range(MIDDLE + 1):
        bias_part(gradient, layer, sizes)[:] = of_biases[layer]
    of_last_parts[1][:] = of_rows.sum(0)
    return sums.astype(np.float32)


@device
def _encoder_biases(flat, sizes):  # type: ignore[no-untyped-def]
    """Biases (layers, width) of the encoder's layers but the last."""
    biases = np.empty((MIDDLE + 1, sizes.width), np.float32)
    for layer in range(MIDDLE + 1):
        biases[layer] = bias_part(flat, layer, sizes)
    return biases


@device
def _flat_rays(values):  # type: ignore[no-untyped-def]
    """Array (V R, n) of what R views of V voxels have, (V, R, n)."""
    return values.reshape((values.shape[0] * values.shape[1], values.shape[2]))


@device
def _empty_kept(views, widths):  # type: ignore[no-untyped-def]
    """Memory of what `differentiate_views` needs of a forward pass."""
    rows, inputs = filled(views, ROWS), filled(widths[0], LANES)
    width, outputs = filled(widths[DECODER_LAYERS - 1], LANES), filled(widths[DECODER_LAYERS], LANES)
    return (
        aligned_floats(rows * inputs).reshape((rows, inputs)),
        aligned_floats((DECODER_LAYERS - 1) * rows * width).reshape((DECODER_LAYERS - 1, rows, width)),
        aligned_floats(rows * outputs).reshape((rows, outputs)),
    )
