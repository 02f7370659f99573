# SPDX-License-Identifier: GPL-3.0-or-later
"""Symmetries of the cube, all 48, as matrices and as permutations of a brick's blocks and cells (methods 7.20)."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np

from ...patchnet_addon.runtime.bounds import DEFAULT_LOOKAHEAD

COUNT = 48


class Symmetries(NamedTuple):
    """Tables of the 48 symmetries; number 0 is the identity.

    axis: (48, 3) int32 and sign: (48, 3) float32: component i of a mapped vector is sign[i] * v[axis[i]].
    block: (48, 27) int32 and cell: (48, 8^n) int32 for a look-ahead of n levels: where a brick's block, and a cell
    within its block, goes.
    """

    axis: np.ndarray
    sign: np.ndarray
    block: np.ndarray
    cell: np.ndarray

    def matrix(self, index: int) -> np.ndarray:
        """Symmetry as a (3, 3) float64 matrix that acts on column vectors."""
        matrix = np.zeros((3, 3))
        matrix[np.arange(3), self.axis[index]] = self.sign[index]
        return matrix


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
    moved = sign[:, None, :] * np.take_along_axis(
        np.broadcast_to(centred, (COUNT, *centred.shape)), np.broadcast_to(axis[:, None, :], (COUNT, *centred.shape)), 2
    )
    places = np.rint((moved + side - 1) / 2).astype(np.int32)
    return (places[..., 0] + side * places[..., 1] + side**2 * places[..., 2]).astype(np.int32)
