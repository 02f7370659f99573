# SPDX-License-Identifier: GPL-3.0-or-later
"""Leaf levels of an octree, block by block of space."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..runtime.bounds import MAX_DEPTH

# Fragments whose leaves are summed at a time; a leaf takes 75 to 200 bytes meanwhile.
BLOCK_FRAGMENTS = 16_000_000


@dataclass(frozen=True, eq=False)
class LeafLevels:
    """Level of the leaves in each block; a block is a cell of level `block_level`.

    levels: (8^block_level,) uint8 over the Morton keys of blocks, at least `block_level`; 0: no leaves there.
    """

    levels: np.ndarray

    @classmethod
    def uniform(cls, depth: int, block_level: int = 0) -> LeafLevels:
        """All leaves on level `depth`."""
        return cls(np.full(8**block_level, depth, np.uint8))

    @cached_property
    def block_level(self) -> int:
        """Level whose cells are the blocks."""
        return (len(self.levels).bit_length() - 1) // 3

    @cached_property
    def used(self) -> tuple[int, ...]:
        """Different levels of leaves, ascending."""
        counts = np.bincount(self.levels, minlength=MAX_DEPTH + 1)
        return tuple(int(level) for level in np.flatnonzero(counts) if level > 0)

    @property
    def deepest(self) -> int:
        """Level of the finest leaves."""
        return max(self.used, default=0)

    def divided(self, block_level: int) -> LeafLevels:
        """Divide the blocks into those of a finer level, up to the level of their leaves."""
        more = min(block_level, *self.used) - self.block_level if self.used else 0
        return self if more <= 0 else LeafLevels(np.repeat(self.levels, 8**more))
