# SPDX-License-Identifier: GPL-3.0-or-later
"""Decoder of a batch forward and backward: a kernel each, which takes a tile of views through all layers.

What stands between layers is computed and used while it lies in the nearest caches. The kernels are serial, since
several threads learn from a part of a step each.
"""

from __future__ import annotations

import numpy as np

from ...patchnet_addon.network.lanes import LANES, load, zeros
from ...patchnet_addon.runtime.aligned_memory import aligned_zeros
from ...patchnet_addon.runtime.kernels import kernel, lean_device
from ...patchnet_addon.runtime.vectors import less, select, store
from .decoder_inputs import add_codes_gradient, write_inputs
from .decoder_outputs import limit_outputs, mix_luminances, scale_outputs
from .decoder_packing import code_columns, empty_sums, mixes, pack_backward, pack_forward, unpack_sums
from .decoder_products import ROWS, add_products, apply_layer, filled

TILE = 128  # views; with fewer, matrices and sums come to the nearest cache more often
assert TILE % LANES == 0


@kernel
def decode_views(eight, rays, near, luminances, layers, kept, found):
    """Write coverage and luminance (V R, 2), and what `differentiate_views` needs.

    eight, rays, near: see `write_inputs`. luminances: (V R, 65), or without rows. layers: matrices (out, in) and biases
    (out,), all but the last with as many outputs. kept: inputs (n, in), results of each layer with ReLU
    (layers, n, out) and slopes of the outputs (n, out), of the V R views filled up to a multiple of `ROWS`, and widths
    to whole vectors.
    """
    matrices, biases = layers
    inputs, hidden, slopes = kept
    weights, bias = pack_forward(matrices, biases)
    outputs = aligned_zeros(TILE, slopes.shape[1])
    floor, none = np.zeros(1, np.float32), np.full(1, -np.inf, np.float32)
    for first in range(0, len(inputs), TILE):
        last = min(first + TILE, len(inputs))
        values, slope, there = inputs[first:last], slopes[first:last], found[first:last]
        write_inputs(eight, rays, near, first, values)
        for layer in range(len(hidden)):
            results = hidden[layer][first:last]
            apply_layer(values, matrices[layer].shape[1], weights[layer], bias[layer], floor, results)
            values = results
        apply_layer(values, matrices[-1].shape[1], weights[-1], bias[-1], none, outputs[: last - first])
        slope[:] = 0
        if mixes(matrices):
            mix_luminances(outputs, near[1][first:last], luminances[first:last], there, slope)
        else:
            limit_outputs(outputs, there, slope)


@kernel
def differentiate_views(gradient, kept, entry, matrices, of_codes, of_layers):
    """Write the gradients of codes (V, 8, 10) and of matrices and biases, for that of coverage and luminance (V R, 2).

    kept: what `decode_views` has written. entry: (V R, 3). of_layers: matrices and biases.
    """
    inputs, hidden, slopes = kept
    weights = pack_backward(matrices)
    sums, bias_sums = empty_sums(matrices)
    of_hidden = aligned_zeros(2 * TILE, hidden.shape[2]).reshape(2, TILE, hidden.shape[2])  # in turns
    of_outputs, of_inputs = aligned_zeros(TILE, slopes.shape[1]), aligned_zeros(TILE, code_columns(matrices))
    nothing, none = aligned_zeros(1, weights.shape[2])[0], np.full(1, -np.inf, np.float32)
    of_codes[:] = 0
    for tile in range(filled(len(inputs), TILE) // TILE - 1, -1, -1):  # what was written last is still in a cache
        first = tile * TILE
        last = min(first + TILE, len(inputs))
        after = of_outputs[: last - first]
        scale_outputs(slopes[first:last], gradient[first:last], after)
        for layer in range(len(hidden), -1, -1):
            values = hidden[layer - 1][first:last] if layer > 0 else inputs[first:last]
            before = of_hidden[layer % 2][: last - first] if layer > 0 else of_inputs[: last - first]
            outs = len(matrices[layer])
            _add_rows(after, bias_sums[layer])
            add_products(after, filled(outs, ROWS), values, none, sums[layer])
            apply_layer(after, outs, weights[layer], nothing, none, before)
            if layer > 0:
                _mask(before, values)
                after = before
        add_codes_gradient(of_inputs[: last - first], inputs[first:last], entry, first, of_codes)
    unpack_sums(sums, bias_sums, *of_layers)


@lean_device
def _add_rows(values, sums):
    """Add the rows of values (n, width) to sums (>= width,)."""
    width = values.shape[1]
    for column in range(0, width, LANES):
        total = load(sums, column)
        for row in range(len(values)):
            total = total + load(values, row * width + column)
        store(sums, column, total)


@lean_device
def _mask(gradient, results):
    """Set a gradient (n, width) to 0 where results (n, width) of a ReLU are."""
    for at in range(0, gradient.size, LANES):
        store(gradient, at, select(less(zeros(), load(results, at)), load(gradient, at), zeros()))
