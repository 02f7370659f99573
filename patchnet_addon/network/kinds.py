# SPDX-License-Identifier: GPL-3.0-or-later
"""Kinds of PatchNet by inputs and outputs of the decoder: the paper's, and the luminance mixture.

The paper's decoder maps the interpolated code and the ray to coverage and luminance (methods 7.13 to 7.15).

The luminance mixture (methods 11.1) encodes shape only: its encoder's luminance columns are zero. Further inputs of its
decoder are the view of the voxel in the ray's own frame, part of each of the eight corner codes, and the share of the
pixel that each nearby cell covers on its own. Its outputs are coverage, and shares of luminances that the octree holds:
those of the voxel's eight children, of the 56 cells of their size around it, and the voxel's own. So its luminance
follows every change of light exactly.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

CODE_SIZE = 10
HARMONICS = 25
CHILDREN, CORNERS = 8, 8
OUTER = 4**3 - CHILDREN  # cells of the children's size around a voxel, to half its side
COVERING = CHILDREN + OUTER
MIXED = COVERING + 1  # luminances, in this order: of the children, of the outer cells, of the voxel
SIDE_BY_SIDE = 4  # first numbers of each corner code that are inputs of the mixture's decoder

RAY_INPUTS = CODE_SIZE + 3 + 3 + 1 + HARMONICS  # inputs of both kinds, methods 7.15
WIDTH_STEP = 6  # step of decoders' widths: kernels compute so many outputs at once
VIEW = 9  # direction, entry point and up in the ray's frame
VIEWS = RAY_INPUTS + CORNERS * SIDE_BY_SIDE  # rows of the mixture's inputs: the view in the ray's frame,
COVERED = VIEWS + VIEW  # and covered shares of children and outer cells
OUTPUT_LOW, OUTPUT_RANGE = -1.0, 3.0  # out = -1 + 3 sigmoid(x)


@dataclass(frozen=True)
class NetworkKind:
    """Kind of network.

    decoder: values between the decoder's layers, inputs first. inputs, output: descriptions, as in files. mixes:
    outputs shares of known luminances instead of a luminance; such decoders have several widths.
    """

    name: str
    decoder: tuple[int, ...]
    inputs: str
    output: str
    mixes: bool

    @property
    def width(self) -> int:
        """Values between the decoder's layers with ReLU, the same for all."""
        return self.decoder[1]

    def of_width(self, width: int) -> NetworkKind:
        """This kind with a decoder of so many values between its layers."""
        if width == self.width:
            return self
        inputs, *hidden, outputs = self.decoder
        return replace(self, decoder=(inputs, *[width] * len(hidden), outputs))


PAPER = NetworkKind(
    name="paper",
    decoder=(RAY_INPUTS, 48, 48, 48, 2),
    inputs="code, direction, up, pixel-voxel ratio, 25 harmonics; axes of the octree",
    output="-1 + 3 sigmoid; coverage, luminance",
    mixes=False,
)
MIXTURE = NetworkKind(
    name="mixture",
    decoder=(RAY_INPUTS + CORNERS * SIDE_BY_SIDE + VIEW + COVERING, 78, 78, 78, 1 + MIXED),
    inputs="code, direction, up, pixel-voxel ratio, 25 harmonics, four numbers of each corner code, x fastest; axes of "
    "the octree; direction, entry -1 to 1, up, coverage of children and of cells around by their own "
    "children; axes of the ray's frame",
    output="-1 + 3 sigmoid, coverage; softmax times coverage, shares of luminance of children, cells around, voxel",
    mixes=True,
)
KINDS = {kind.name: kind for kind in (PAPER, MIXTURE)}
