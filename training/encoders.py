# SPDX-License-Identifier: GPL-3.0-or-later
"""Encoders by architecture: the paper's layers, and two convolutional ones for the paper's comparison.

`mlp` is the paper's (methods 7.12), which the engine runs. The two others run on torch in research commands: they
convolve the patch down to 2x2x2 cells, with ReLU after every stage, and two linear layers map these to the code. The
hidden layer is as wide as fits the number of parameters of the paper's `mlp` with the same look-ahead.

Voxception blocks are those of Brock, Lim, Ritchie, Weston, "Generative and Discriminative Voxel Modeling with
Convolutional Neural Networks", 2016 (arXiv 1608.04236): parallel convolutions of 3x3x3 and of 1x1x1 cells; and to halve
the sides, four branches of a quarter of the filters each: a 3x3x3 and a 1x1x1 convolution of stride 2, and two 3x3x3
convolutions followed by max or mean pooling of 3x3x3 cells. This version has no batch norm, and ReLU instead of ELU.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ..patchnet_addon.network import weights
from ..patchnet_addon.network.encoders import CHANNELS, LUMINANCE, MLP, EncoderKind, parameters_of
from ..patchnet_addon.network.kinds import CODE_SIZE

MAXIMUM, MEAN = "maximum", "mean"
_LAST_SIDE = 2  # side of the convolutions' output in cells
_WIDTH_STEP = 16  # of the hidden linear layer of encoders that convolve
_CONV3D_FILTERS, _VOXCEPTION_FILTERS = 16, 8


@dataclass(frozen=True)
class Branch:
    """Convolution with zero padding.

    side: of its kernels, 3 or 1. stride: 1, or 2 to halve the sides. pool: MAXIMUM or MEAN of 3x3x3 cells with stride
    2, after a convolution of stride 1; a mean includes the padding, a maximum does not.
    """

    filters: int
    side: int
    stride: int = 1
    pool: str = ""


Stage = tuple[Branch, ...]
"""Parallel branches whose outputs are concatenated, followed by ReLU."""


@dataclass(frozen=True)
class ConvolvingKind(EncoderKind):
    """Architecture that convolves; stages: its convolutions for a look-ahead."""

    width: int = field(default=0, init=False)
    stages: Callable[[int], tuple[Stage, ...]]

    def shapes(self, lookahead: int) -> tuple[tuple[int, ...], ...]:
        """Shapes of the layers' matrices (out, in) and kernels (out, in, z, y, x), branches in their order."""
        kernels: list[tuple[int, ...]] = []
        channels = CHANNELS
        for stage in self.stages(lookahead):
            kernels += [(branch.filters, channels, *(branch.side,) * 3) for branch in stage]
            channels = sum(branch.filters for branch in stage)
        flat = channels * _LAST_SIDE**3
        left = MLP.parameters(lookahead) - parameters_of(kernels) - CODE_SIZE
        width = left // (flat + 1 + CODE_SIZE) // _WIDTH_STEP * _WIDTH_STEP
        return (*kernels, (width, flat), (CODE_SIZE, width))

    def hide_luminance(self, layers: Sequence[weights.Layer], lookahead: int) -> None:
        """Zero the first layers' weights of luminance."""
        for kernels, _ in layers[: len(self.stages(lookahead)[0])]:
            kernels[:, LUMINANCE] = 0


def _convolutions(lookahead: int) -> tuple[Stage, ...]:
    """A convolution at full size, and one with twice the filters for each halving of the sides."""
    first = _CONV3D_FILTERS
    return ((Branch(first, 3),), *((Branch(first << halving, 3, 2),) for halving in range(1, lookahead + 1)))


def _voxception(lookahead: int) -> tuple[Stage, ...]:
    """A Voxception block at each size but the last, then one that halves the sides and doubles the filters."""
    stages: list[Stage] = []
    for halving in range(lookahead):
        filters = _VOXCEPTION_FILTERS << halving
        stages += [(Branch(filters // 2, 3), Branch(filters // 2, 1)), _voxception_down(2 * filters)]
    return tuple(stages)


def _voxception_down(filters: int) -> Stage:
    each = filters // 4
    return Branch(each, 3, 2), Branch(each, 1, 2), Branch(each, 3, pool=MAXIMUM), Branch(each, 3, pool=MEAN)


CONV3D = ConvolvingKind(
    "conv3d",
    "3x3x3 convolutions, 16 filters, doubled by each of stride 2, to 2x2x2 cells; channel, z, y, x; two linear layers",
    stages=_convolutions,
)
VOXCEPTION = ConvolvingKind(
    "voxception",
    "Voxception blocks (3x3x3, 1x1x1), 8 filters, doubled by each that halves (3x3x3 and 1x1x1 of stride 2, 3x3x3 "
    "with maximum, 3x3x3 with mean), to 2x2x2 cells; channel, z, y, x; two linear layers",
    stages=_voxception,
)
ENCODERS: dict[str, EncoderKind] = {kind.name: kind for kind in (MLP, CONV3D, VOXCEPTION)}


def load_weights(path: str | Path | None = None) -> weights.Weights:
    """Read weights with any of these encoders, or the shipped ones; raises WeightsFileError."""
    return weights.load_weights(path, ENCODERS)
