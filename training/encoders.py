# SPDX-License-Identifier: GPL-3.0-or-later
"""Encoders by architecture: the paper's layers, and two that convolve, for the paper's comparison alone.

`mlp` is the paper's (methods 7.12), which the engine runs. The two others run on torch, in research commands: they
convolve the patch down to 2x2x2 cells, with ReLU behind every stage, and two linear layers make the code of these. The
hidden one is as wide as leaves the whole encoder no more parameters than the paper's `mlp` of the same look-ahead has.

Voxception blocks are those of Brock, Lim, Ritchie, Weston, "Generative and Discriminative Voxel Modeling with
Convolutional Neural Networks", 2016 (arXiv 1608.04236): convolutions of 3x3x3 and of 1x1x1 cells side by side; and to
halve the sides, four of a quarter of the filters each: a 3x3x3 and a 1x1x1 convolution of stride 2, and two 3x3x3
convolutions behind which the largest, or the mean, of 3x3x3 cells is taken. Ours has no batch norm, and ReLU for ELU.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ..patchnet_addon.network import weights
from ..patchnet_addon.network.encoders import CHANNELS, LUMINANCE, MLP, EncoderKind, parameters_of
from ..patchnet_addon.network.kinds import CODE_SIZE

MAXIMUM, MEAN = "maximum", "mean"
_LAST_SIDE = 2  # cells along a side of what the convolutions leave
_WIDTH_STEP = 16  # of the hidden linear layer of encoders that convolve
_CONV3D_FILTERS, _VOXCEPTION_FILTERS = 16, 8


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


Stage = tuple[Branch, ...]
"""Branches on the same cells; what they make stands side by side, and ReLU follows."""


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
        """Set what the first layers would see of luminance to zero."""
        for kernels, _ in layers[: len(self.stages(lookahead)[0])]:
            kernels[:, LUMINANCE] = 0


def _convolutions(lookahead: int) -> tuple[Stage, ...]:
    """A convolution at full size, and one of twice the filters for each time that the sides are halved."""
    first = _CONV3D_FILTERS
    return ((Branch(first, 3),), *((Branch(first << halving, 3, 2),) for halving in range(1, lookahead + 1)))


def _voxception(lookahead: int) -> tuple[Stage, ...]:
    """A Voxception block at each size but the last, and one that halves the sides with twice the filters behind it."""
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
    """Read weights with any of these encoders, or those that are shipped; raises WeightsFileError."""
    return weights.load_weights(path, ENCODERS)
