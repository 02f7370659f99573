# SPDX-License-Identifier: GPL-3.0-or-later
"""PatchNet's encoder on compiled products of our own, on all cores; the scheme is that of `encode.py`.

It is the one that is used without torch. NumPy's products depend on its BLAS: that of Debian's Blender is nine times
slower than the one in pip's NumPy, and even the fast one multiplies all the zeros of blocks and activations.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..runtime.threads import run_parts
from .encode import Buffers, sum_octants
from .encoders import CHANNELS, LUMINANCE
from .octants import octant_matrices
from .product import Panels, multiply
from .weights import Weights


class PackedLayers(NamedTuple):
    """Layers of the encoder in panels, as `Panels` has them, for kernels that run all of them.

    octants: (8 * P, B, WIDTH) the first layer's, octant by octant. first_bias: (256,). panels: (Q, 256, WIDTH) of the
    layers behind it, one after the other. bias: (Q * WIDTH,) of these. least: (2,) the smallest result of a layer, and
    of the last. sees_luminance: whether a cell's luminance changes anything; a luminance mixture sees shape alone.
    """

    octants: np.ndarray
    first_bias: np.ndarray
    panels: np.ndarray
    bias: np.ndarray
    least: np.ndarray
    sees_luminance: bool


class CompiledEncoder:
    """`Encoder` on the kernels of `product.py`; it keeps its buffers.

    `codes/encode_corners.py` runs its layers with blocks and sums in one kernel, chunk by chunk on each core, and makes
    the same bits; calling it is the Reference of that. A chunk's blocks and sums fit the second cache of a core.
    """

    def __init__(self, weights: Weights) -> None:
        self.chunk = {1: 512, 2: 512, 3: 128}[weights.lookahead]
        matrix, self._bias = weights.encoder[0]
        self._octants = Panels.pack(octant_matrices(matrix))
        self._layers = [Panels.pack(matrix.T, bias) for matrix, bias in weights.encoder[1:]]
        self._buffers = Buffers()

    @cached_property
    def layers(self) -> PackedLayers:
        """All layers for one kernel."""
        return PackedLayers(
            self._octants.matrix,
            self._bias,
            np.concatenate([layer.matrix for layer in self._layers]),
            np.concatenate([layer.bias for layer in self._layers]),
            np.array([0, -np.inf], np.float32),
            bool(self._octants.matrix[:, LUMINANCE::CHANNELS].any()),
        )

    def __call__(self, blocks: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Encode as `Encoder` says."""
        products = self._buffers("products", len(blocks), self._octants.width)  # (U, 8 * 256)
        multiply(blocks, self._octants, products, order=similar_order(blocks))
        values = self._buffers("layer 0", len(rows), len(self._bias))
        run_parts(sum_octants, len(rows), products, np.asarray(rows, np.int64), self._bias, values)
        for index, layer in enumerate(self._layers, 1):
            result = self._buffers(f"layer {index}", len(rows), layer.width)
            multiply(values, layer, result, relu=index < len(self._layers))
            values = result
        return values[:, : self._layers[-1].columns].copy()


def similar_order(blocks: np.ndarray) -> np.ndarray:
    """Order (U,) of blocks (U, B) that puts those with the same occupied cells side by side, for `multiply`."""
    occupied = np.packbits(blocks[:, ::CHANNELS] != 0, axis=1)
    words = np.pad(occupied, ((0, 0), (0, -occupied.shape[1] % 8))).view(">u8")  # one word of 64 cells for two levels
    if words.shape[1] == 1:
        return np.argsort(words[:, 0], kind="stable")
    return np.lexsort(words.T[::-1])
