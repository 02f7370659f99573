# SPDX-License-Identifier: GPL-3.0-or-later
"""Encoders of PatchNet by architecture: the paper's layers, 3D convolutions, and Voxception blocks.

All take a corner's patch and make its code of ten numbers; the decoder is the same for all. `mlp` is the paper's
(methods 7.12), which our own kernels run, and comes in several widths: how wide it is costs time when codes are made,
and none when pixels are decoded. The two others are there for research: they convolve the patch down to 2x2x2 cells,
with ReLU behind every stage, and two linear layers make the code of these. The hidden one is as wide as leaves the
whole encoder no more parameters than the paper's `mlp` of the same look-ahead has. They need torch.

Voxception blocks are those of Brock, Lim, Ritchie, Weston, "Generative and Discriminative Voxel Modeling with
Convolutional Neural Networks", 2016 (arXiv 1608.04236): convolutions of 3x3x3 and of 1x1x1 cells side by side; and to
halve the sides, four of a quarter of the filters each: a 3x3x3 and a 1x1x1 convolution of stride 2, and two 3x3x3
convolutions behind which the largest, or the mean, of 3x3x3 cells is taken. Ours has no batch norm, and ReLU for ELU.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

from .kinds import CODE_SIZE

CHANNELS = 5  # of a cell: occupancy, luminance, three of the normal
LUMINANCE = 1  # its place among them
MAXIMUM, MEAN = "maximum", "mean"
_LAST_SIDE = 2  # cells along a side of what the convolutions leave
_WIDTH_STEP = 16  # of the hidden linear layer of encoders that convolve
MLP_WIDTH_STEP = 64  # kernels compute whole vectors of a layer's values
_MLP_HIDDEN = 3  # layers of as many values
_FIRST_FILTERS = {"conv3d": 16, "voxception": 8}


def patch_side(lookahead: int) -> int:
    """Cells along a side of a corner's patch, 2 * 2^lookahead (methods 7.9)."""
    return 2 << lookahead


@dataclass(frozen=True)
class Branch:
    """Convolution with zeros around the patch.

    side: of its kernels, 3 or 1. stride: 1, or 2 to halve the sides. pool: MAXIMUM or MEAN of 3x3x3 cells at every
    second place, behind a convolution of stride 1; a mean counts the zeros around, a maximum does not.
    """

    filters: int
    side: int
    stride: int = 1
    pool: str = ""

    @property
    def halves(self) -> bool:
        """Whether it leaves half of the cells along a side."""
        return self.stride == 2 or bool(self.pool)


Stage = tuple[Branch, ...]
"""Branches on the same cells; what they make stands side by side, and ReLU follows."""


@dataclass(frozen=True)
class EncoderKind:
    """Architecture of an encoder.

    stages: its convolutions for a look-ahead, none for `mlp`. width: values between the linear layers of `mlp`, a
    multiple of `MLP_WIDTH_STEP`; 0 for encoders that convolve, which the look-ahead decides.
    """

    name: str
    text: str
    stages: Callable[[int], tuple[Stage, ...]]
    width: int = 0

    @property
    def convolves(self) -> bool:
        """Whether it is one of those that need torch."""
        return bool(self.stages(1))

    def of_width(self, width: int) -> EncoderKind:
        """This encoder with so many values between its linear layers; of `mlp` alone."""
        assert not self.convolves
        return self if width == self.width else replace(self, width=width)

    def sizes(self, lookahead: int) -> tuple[int, ...]:
        """Values between the layers of `mlp`, those of a patch first (methods 7.12)."""
        return (patch_side(lookahead) ** 3 * CHANNELS, *[self.width] * _MLP_HIDDEN, CODE_SIZE)

    def shapes(self, lookahead: int) -> tuple[tuple[int, ...], ...]:
        """Shapes of the layers' matrices (out, in) and kernels (out, in, z, y, x), branches in their order."""
        if not self.convolves:
            return tuple((after, before) for before, after in pairwise(self.sizes(lookahead)))
        kernels: list[tuple[int, ...]] = []
        channels = CHANNELS
        for stage in self.stages(lookahead):
            kernels += [(branch.filters, channels, *(branch.side,) * 3) for branch in stage]
            channels = sum(branch.filters for branch in stage)
        flat = channels * _LAST_SIDE**3
        left = MLP.parameters(lookahead) - _parameters(kernels) - CODE_SIZE
        width = left // (flat + 1 + CODE_SIZE) // _WIDTH_STEP * _WIDTH_STEP
        return (*kernels, (width, flat), (CODE_SIZE, width))

    def parameters(self, lookahead: int) -> int:
        """Number of its weights and biases."""
        return _parameters(self.shapes(lookahead))


def _parameters(shapes: tuple[tuple[int, ...], ...] | list[tuple[int, ...]]) -> int:
    return sum(math.prod(shape) + shape[0] for shape in shapes)


def _convolutions(lookahead: int) -> tuple[Stage, ...]:
    """A convolution at full size, and one of twice the filters for each time that the sides are halved."""
    first = _FIRST_FILTERS["conv3d"]
    return ((Branch(first, 3),), *((Branch(first << halving, 3, 2),) for halving in range(1, lookahead + 1)))


def _voxception(lookahead: int) -> tuple[Stage, ...]:
    """A Voxception block at each size but the last, and one that halves the sides with twice the filters behind it."""
    stages: list[Stage] = []
    for halving in range(lookahead):
        filters = _FIRST_FILTERS["voxception"] << halving
        stages += [(Branch(filters // 2, 3), Branch(filters // 2, 1)), _voxception_down(2 * filters)]
    return tuple(stages)


def _voxception_down(filters: int) -> Stage:
    each = filters // 4
    return Branch(each, 3, 2), Branch(each, 1, 2), Branch(each, 3, pool=MAXIMUM), Branch(each, 3, pool=MEAN)


MLP = EncoderKind("mlp", "linear layers", lambda lookahead: (), width=256)
CONV3D = EncoderKind(
    "conv3d",
    "3x3x3 convolutions, 16 filters, doubled by each of stride 2, to 2x2x2 cells; channel, z, y, x; two linear layers",
    _convolutions,
)
VOXCEPTION = EncoderKind(
    "voxception",
    "Voxception blocks (3x3x3, 1x1x1), 8 filters, doubled by each that halves (3x3x3 and 1x1x1 of stride 2, 3x3x3 "
    "with maximum, 3x3x3 with mean), to 2x2x2 cells; channel, z, y, x; two linear layers",
    _voxception,
)
ENCODERS = {kind.name: kind for kind in (MLP, CONV3D, VOXCEPTION)}
