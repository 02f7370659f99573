# SPDX-License-Identifier: GPL-3.0-or-later
"""Kinds of PatchNet, by what the decoder is given and what it says: the paper's, and the luminance mixture.

The paper's decoder takes the interpolated code and the ray, and says coverage and luminance (methods 7.13 to 7.15).

The luminance mixture (methods 11.1) sees shape alone: its encoder's luminance columns are zero. Its decoder is also
told how it looks at the voxel, in the ray's own frame, part of the eight corner codes side by side, and how much of the
pixel each cell around would cover alone. It says coverage, and shares of luminances that the octree has at hand: those
of the voxel's eight children, of the 56 cells of their size around it, and the voxel's own. So its luminance follows
every change of light exactly.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

CODE_SIZE = 10
HARMONICS = 25
CHILDREN, CORNERS = 8, 8
OUTER = 4**3 - CHILDREN  # cells of the children's size around a voxel, to half its side
COVERING = CHILDREN + OUTER
MIXED = COVERING + 1  # luminances, in this order: of the children, of the outer cells, of the voxel
SIDE_BY_SIDE = 4  # first numbers of each corner code that the mixture's decoder sees apart

RAY_INPUTS = CODE_SIZE + 3 + 3 + 1 + HARMONICS  # inputs of both kinds, methods 7.15
WIDTH_STEP = 6  # of decoders: kernels compute so many outputs of a layer at once
VIEW = 9  # direction, entry point and up in the ray's frame
VIEWS = RAY_INPUTS + CORNERS * SIDE_BY_SIDE  # rows of the mixture's inputs: the view in the ray's frame,
COVERED = VIEWS + VIEW  # and what children and outer cells cover
OUTPUT_LOW, OUTPUT_RANGE = -1.0, 3.0  # out = -1 + 3 sigmoid(x)


@dataclass(frozen=True)
class NetworkKind:
    """Kind of network.

    decoder: values between the decoder's layers, those of a pixel first. inputs, output: in words, as files state
    them. mixes: says shares of known luminances in the place of a luminance; such decoders come in several widths.
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
