# SPDX-License-Identifier: GPL-3.0-or-later
"""Augmentation of voxels (methods 7.20): a random range of luminance, and the 48 symmetries of the cube."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from ...patchnet_addon.runtime.bounds import DEFAULT_LOOKAHEAD

COUNT = 48  # symmetries


@dataclass(frozen=True, eq=False)
class Augmentation:
    """Augmentation of each of V voxels.

    symmetry: (V,) int32 number of the cube symmetry, 0 for none.
    remap: (V, 4) float32: gain, place of the result in its free range [0, 1], 1 to invert, 1 to remap at all.
    """

    symmetry: np.ndarray
    remap: np.ndarray

    @classmethod
    def none(cls, count: int) -> Augmentation:
        """No augmentation of `count` voxels."""
        return cls(np.zeros(count, np.int32), np.zeros((count, 4), np.float32))

    @classmethod
    def random(cls, count: int, random: np.random.Generator) -> Augmentation:
        """Random symmetry for each voxel, and a random range of luminance for half of them (methods 7.20)."""
        remap = random.random((count, 4), np.float32)
        remap[:, 0] += 0.5
        remap[:, 2:] = remap[:, 2:] < 0.5
        return cls(random.integers(0, COUNT, count).astype(np.int32), remap)


class Symmetries(NamedTuple):
    """Tables of the 48 symmetries; number 0 is the identity.

    axis: (48, 3) int32 and sign: (48, 3) float32: component i of a mapped vector is sign[i] * v[axis[i]]. block: (48,
    27) int32 and cell: (48, 8^n) int32 for a look-ahead of n levels: destination of a brick's block, and of a cell
    within its block.
    """

    axis: np.ndarray
    sign: np.ndarray
    block: np.ndarray
    cell: np.ndarray


@cache
def cube_symmetries(lookahead: int = DEFAULT_LOOKAHEAD) -> Symmetries:
    """All axis permutations with all sign flips, for blocks of 2^lookahead cells a side."""
    pairs = list(itertools.product(itertools.permutations(range(3)), itertools.product((1.0, -1.0), repeat=3)))
    axis = np.array([permutation for permutation, _ in pairs], np.int32)  # (48, 3)
    sign = np.array([signs for _, signs in pairs], np.float32)  # (48, 3)
    return Symmetries(axis, sign, _permutation(axis, sign, 3), _permutation(axis, sign, 1 << lookahead))


def _permutation(axis: np.ndarray, sign: np.ndarray, side: int) -> np.ndarray:
    """Destination (48, side^3) int32 of each cell of a cube of cells, numbered x + side y + side^2 z."""
    index = np.arange(side**3)
    cells = np.stack([index % side, index // side % side, index // side**2], axis=-1)  # (side^3, 3)
    centred = 2 * cells - (side - 1)
    moved = (sign * centred[:, axis]).swapaxes(0, 1)  # (48, side^3, 3)
    places = np.rint((moved + side - 1) / 2).astype(np.int32)
    return (places[..., 0] + side * places[..., 1] + side**2 * places[..., 2]).astype(np.int32)
