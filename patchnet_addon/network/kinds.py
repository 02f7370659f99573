# SPDX-License-Identifier: GPL-3.0-or-later
"""Kinds of PatchNet, by what the decoder is given and what it says: the paper's, and the luminance mixture.

The paper's decoder takes the interpolated code and the ray, and says coverage and luminance (methods 7.13 to 7.15).

The luminance mixture (methods 11.1) sees shape alone: its encoder's luminance columns are zero. Its decoder also takes
the eight corner codes side by side, the entry point, and how much of the ray each of the voxel's children covers; it
says coverage, and shares of luminances that the octree has at hand: those of the eight children as they are seen along
the ray, the voxel's own, and those around its eight corners. So its luminance follows every change of light exactly.
"""

from __future__ import annotations

from dataclasses import dataclass

CODE_SIZE = 10
HARMONICS = 25
CHILDREN, CORNERS = 8, 8
MIXED = CHILDREN + 1 + CORNERS  # luminances, in this order: of the children, of the voxel, around its corners

_RAY = CODE_SIZE + 3 + 3 + 1 + HARMONICS  # inputs of both kinds, methods 7.15


@dataclass(frozen=True)
class NetworkKind:
    """Kind of network.

    decoder: values between the decoder's layers, those of a pixel first. inputs, output: in words, as files state
    them. mixes: says shares of known luminances in the place of a luminance.
    """

    name: str
    decoder: tuple[int, ...]
    inputs: str
    output: str
    mixes: bool


PAPER = NetworkKind(
    name="paper",
    decoder=(_RAY, 48, 48, 48, 2),
    inputs="code, direction, up, pixel-voxel ratio, 25 harmonics; axes of the octree",
    output="-1 + 3 sigmoid; coverage, luminance",
    mixes=False,
)
MIXTURE = NetworkKind(
    name="mixture",
    decoder=(_RAY + CORNERS * CODE_SIZE + 3 + CHILDREN, 60, 60, 60, 1 + MIXED),
    inputs="code, direction, up, pixel-voxel ratio, 25 harmonics, corner codes x fastest, entry -1 to 1, coverage of "
    "the children along the ray; axes of the octree",
    output="-1 + 3 sigmoid, coverage; softmax, shares of luminance of children, voxel, corners",
    mixes=True,
)
KINDS = {kind.name: kind for kind in (PAPER, MIXTURE)}
