# SPDX-License-Identifier: GPL-3.0-or-later
"""Matrices of the decoder's layers as its kernels read them, and sums of their gradients, for kernels.

Those of all layers are one array with room for the largest in each, and rows begin at whole vectors. What is beyond a
matrix is zeros. A mixture's outputs are turned by one: coverage, which is the first, stands behind the luminances.
"""

from __future__ import annotations

from ...patchnet_addon.network.kinds import CODE_SIZE, RAY_INPUTS
from ...patchnet_addon.network.lanes import LANES
from ...patchnet_addon.runtime.aligned_memory import aligned_zeros
from ...patchnet_addon.runtime.kernels import device
from .decoder_inputs import BESIDE, CODE_PLACE
from .decoder_products import ROWS, filled


@device
def mixes(matrices):
    """Whether these are the matrices (out, in) of a mixture's decoder."""
    return matrices[0].shape[1] > RAY_INPUTS


@device
def code_columns(matrices):
    """Columns of a gradient of the inputs that codes have: see `add_codes_gradient`."""
    return CODE_PLACE + BESIDE if mixes(matrices) else CODE_PLACE


@device
def pack_forward(matrices, biases):
    """Transposed matrices (layers, in, out) and biases (layers, out)."""
    layers, most, widest = len(matrices), 0, 0
    for matrix in matrices:
        most, widest = max(most, matrix.shape[1]), max(widest, filled(len(matrix), LANES))
    weights = aligned_zeros(layers * most, widest).reshape(layers, most, widest)
    bias = aligned_zeros(layers, widest)
    for layer in range(layers):
        matrix = matrices[layer]
        for out in range(len(matrix)):
            column = _place(matrices, layer, out)
            bias[layer, column] = biases[layer][out]
            for k in range(matrix.shape[1]):
                weights[layer, k, column] = matrix[out, k]
    return weights, bias


@device
def pack_backward(matrices):
    """Matrices (layers, out, in); of the first, the columns of codes alone, as `add_codes_gradient` has them."""
    layers, most, widest = len(matrices), 0, code_columns(matrices)
    for matrix in matrices:
        most = max(most, len(matrix))
    for matrix in matrices[1:]:
        widest = max(widest, filled(matrix.shape[1], LANES))
    weights = aligned_zeros(layers * most, widest).reshape(layers, most, widest)
    first = matrices[0]
    for out in range(len(first)):
        for k in range(CODE_SIZE):
            weights[0, out, k] = first[out, k]
        for k in range(code_columns(matrices) - CODE_PLACE):
            weights[0, out, CODE_PLACE + k] = first[out, RAY_INPUTS + k]
    for layer in range(1, layers):
        matrix = matrices[layer]
        for out in range(len(matrix)):
            row = _place(matrices, layer, out)
            for k in range(matrix.shape[1]):
                weights[layer, row, k] = matrix[out, k]
    return weights


@device
def empty_sums(matrices):
    """Zeros for the sums of the gradients of matrices (layers, out, in) and biases (layers, out)."""
    layers, most, widest, columns = len(matrices), 0, 0, 0
    for matrix in matrices:
        most, widest = max(most, filled(len(matrix), ROWS)), max(widest, filled(matrix.shape[1], LANES))
        columns = max(columns, filled(len(matrix), LANES))
    return aligned_zeros(layers * most, widest).reshape(layers, most, widest), aligned_zeros(layers, columns)


@device
def unpack_sums(sums, bias_sums, of_matrices, of_biases):
    """Copy these sums into the gradients of matrices and biases, of their own shapes."""
    for layer in range(len(of_matrices)):
        of_matrix, of_bias = of_matrices[layer], of_biases[layer]
        for out in range(len(of_matrix)):
            place = _place(of_matrices, layer, out)
            of_bias[out] = bias_sums[layer, place]
            for k in range(of_matrix.shape[1]):
                of_matrix[out, k] = sums[layer, place, k]


@device
def _place(matrices, layer, out):
    """Where an output of a layer stands."""
    if layer < len(matrices) - 1 or not mixes(matrices):
        return out
    return out - 1 if out > 0 else len(matrices[layer]) - 1
