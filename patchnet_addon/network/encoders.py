# SPDX-License-Identifier: GPL-3.0-or-later
"""Encoder of PatchNet: linear layers from a corner's patch to its code of ten numbers (methods 7.12).

There are several widths, which affect the time of encoding, not of decoding. Training has further architectures, which
the engine does not implement.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Protocol

import numpy as np

from .kinds import CODE_SIZE

OCCUPANCY, LUMINANCE, NORMAL, CHANNELS = 0, 1, 2, 5  # channels of a cell, three of the normal; their number
MLP_WIDTH_STEP = 64  # kernels compute whole vectors of a layer's values
_HIDDEN = 3  # layers of as many values


class Encoder(Protocol):
    """Encoder of the corners of a chunk by other code than the kernels; `chunk` is its preferred number of corners.

    A corner's patch is eight blocks, of 4x4x4 cells each for a look-ahead of two levels, which corners share.
    """

    chunk: int

    def __call__(self, blocks: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Codes (C, 10) float32 of corners whose eight octants hold `blocks[rows]`.

        blocks: (U, B) float32, z, y, x, channel, B = 320 for two levels; block 0 is empty. rows: (C, 8) integers,
        octants x fastest.
        """


def patch_side(lookahead: int) -> int:
    """Cells along a side of a corner's patch, 2 * 2^lookahead (methods 7.9)."""
    return 2 << lookahead


@dataclass(frozen=True)
class EncoderKind:
    """Architecture of an encoder.

    text: description. width: values between its linear layers, a multiple of `MLP_WIDTH_STEP`; 0 if the look-ahead
    determines it.
    """

    name: str
    text: str
    width: int = 0

    def of_width(self, width: int) -> EncoderKind:
        """This encoder with so many values between its linear layers."""
        return self if width == self.width else replace(self, width=width)

    def sizes(self, lookahead: int) -> tuple[int, ...]:
        """Values between the linear layers, those of a patch first (methods 7.12)."""
        return (patch_side(lookahead) ** 3 * CHANNELS, *[self.width] * _HIDDEN, CODE_SIZE)

    def shapes(self, lookahead: int) -> tuple[tuple[int, ...], ...]:
        """Shapes of the layers' matrices (out, in)."""
        return tuple((after, before) for before, after in pairwise(self.sizes(lookahead)))

    def parameters(self, lookahead: int) -> int:
        """Number of its weights and biases."""
        return parameters_of(self.shapes(lookahead))

    def hide_luminance(self, layers: Sequence[tuple[np.ndarray, np.ndarray]], lookahead: int) -> None:
        """Set the first layer's weights of luminance to zero."""
        layers[0][0][:, LUMINANCE::CHANNELS] = 0


def parameters_of(shapes: Iterable[tuple[int, ...]]) -> int:
    """Number of weights and biases of layers of these shapes."""
    return sum(math.prod(shape) + shape[0] for shape in shapes)


MLP = EncoderKind("mlp", "linear layers", width=256)


def octant_matrices(matrix: np.ndarray) -> np.ndarray:
    """First layer's matrix (256, 8 B) as (B, 8 * 256): eight products of one block, octants x fastest.

    B: values of a voxel's block, 5 for each of its cells, whose number is a cube: 320 for a look-ahead of two levels.
    """
    outputs, size = matrix.shape
    side = round((size // 40) ** (1 / 3))
    parts = matrix.reshape(outputs, 2, side, 2, side, 2, side, 5)  # output; octant and cell of z, y, x; channel
    parts = parts.transpose(2, 4, 6, 7, 1, 3, 5, 0)  # cell z, y, x, channel; octant z, y, x; output
    return np.ascontiguousarray(parts.reshape(-1, 8 * outputs))
