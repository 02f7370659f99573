# SPDX-License-Identifier: GPL-3.0-or-later
"""Expected voxels and memory of an octree of a given depth."""

from __future__ import annotations

import os
from typing import NamedTuple

import numpy as np

from ..octree.leaf_levels import BLOCK_FRAGMENTS
from ..octree.octree import Octree
from ..runtime.errors import MemoryEstimateError
from ..runtime.memory import system_bytes
from ..runtime.quantities import bytes_text, count_text

BYTES_PER_NODE = 14
COLOR_BYTES_PER_NODE = 2
BOX_BYTES_PER_LEAF = 3
_SIDES_BYTES_PER_NODE = 1.5  # at most 2.9
# During building, a leaf of the present pass has sums in fixed point (48 bytes and its share of a brick,
# about 25), then a key and sums (28 bytes); a stored leaf and its share of the coarser nodes take 15
# bytes, and twice that while passes are joined. Colour adds 32 bytes in fixed point, 8 to the sums, 2 to the rest.
# A box takes 4 bytes while it grows, 7 when its pass ends, and 3 stored. Sides add 144 bytes while they grow,
# 240 in colour, and 44 or 56 stored for one leaf in six.
_LEAF_BYTES = 15 + BOX_BYTES_PER_LEAF, 105 + 11  # stored, and further bytes during its pass
_COLOR_LEAF_BYTES = 2, 40
_SIDES_LEAF_BYTES = (8, 144), (10, 240)  # without and with colour
# Pieces: 12 bytes for each of about 1.2 and their triangles; 20 while they are collected, and copies of these in order.
_PIECES_LEAF_BYTES = 24, 70
_PASS_LEAVES = BLOCK_FRAGMENTS * 3 // 4
_NODES_PER_LEAF = 1.36


def expected_leaves(coarse: Octree, depth: int) -> int:
    """Expected number of leaves of an octree with `depth` levels over the same cube.

    Voxels along a surface grow as area * 4^level + edges * 2^level; the two finest coarse levels give both terms.
    """
    *_, before, finest = counts = np.diff(coarse.level_start).tolist()
    if depth <= coarse.depth:
        return int(counts[depth])
    area = max(finest - 2 * before, 0) / (2 * 4.0 ** (coarse.depth - 1))
    edges = (finest - area * 4.0**coarse.depth) / 2.0**coarse.depth
    return int(area * 4.0**depth + edges * 2.0**depth)


class Contents(NamedTuple):
    """What an octree holds beside luminance: colour, luminance by direction, pieces of its leaves."""

    color: bool = False
    sides: bool = False
    pieces: bool = False


_PLAIN = Contents()


def stored_bytes(leaves: int, contents: Contents = _PLAIN) -> int:
    """Expected bytes of an octree, without textures."""
    node_bytes = BYTES_PER_NODE + COLOR_BYTES_PER_NODE * contents.color + _SIDES_BYTES_PER_NODE * contents.sides
    leaf_bytes = BOX_BYTES_PER_LEAF + _PIECES_LEAF_BYTES[0] * contents.pieces
    return int(leaves * (_NODES_PER_LEAF * node_bytes + leaf_bytes))


def _bytes_per_leaf(contents: Contents) -> tuple[int, int]:
    """Stored bytes per leaf, and further bytes during its pass."""
    bytes_ = [_LEAF_BYTES] + [_COLOR_LEAF_BYTES] * contents.color + [_SIDES_LEAF_BYTES[contents.color]] * contents.sides
    bytes_ += [_PIECES_LEAF_BYTES] * contents.pieces
    kept, in_pass = (sum(column) for column in zip(*bytes_, strict=True))
    return kept, in_pass


def peak_bytes(leaves: float, contents: Contents = _PLAIN) -> int:
    """Peak memory in bytes of building an octree, without the scene."""
    kept, in_pass = _bytes_per_leaf(contents)
    return int(max(kept * leaves + in_pass * min(leaves, _PASS_LEAVES), 2 * kept * leaves))


def max_leaves(memory_bytes: float, contents: Contents = _PLAIN) -> int:
    """Largest number of leaves of an octree built within `memory_bytes`; inverse of `peak_bytes`."""
    kept, in_pass = _bytes_per_leaf(contents)
    in_one_pass = memory_bytes / (kept + in_pass)
    if in_one_pass <= _PASS_LEAVES:
        return int(max(in_one_pass, 0))
    return int(min((memory_bytes - in_pass * _PASS_LEAVES) / kept, memory_bytes / (2 * kept)))


def available_memory() -> int:
    """Available bytes without swapping; 4 GiB on systems that do not report it."""
    if (available := system_bytes("/proc/meminfo", "MemAvailable")) is not None:
        return available
    if hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2
    return 4 << 30


def _bound(memory_bytes: int | None) -> str:
    """Memory limit in words."""
    if memory_bytes is None:
        return f"{bytes_text(available_memory())} are free"
    return f"the memory limit is {bytes_text(memory_bytes)}"


def check_memory(leaves: int, depth: int, memory_bytes: int | None = None, contents: Contents = _PLAIN) -> None:
    """Raise MemoryEstimateError if an octree of a given depth with that many leaves cannot be built in memory.

    memory_bytes: limit; None for all available memory.
    """
    peak = peak_bytes(leaves, contents)
    if peak > (available_memory() if memory_bytes is None else memory_bytes):
        raise MemoryEstimateError(
            f"Depth {depth} needs about {bytes_text(peak)} for {count_text(leaves)} voxels, and "
            f"{_bound(memory_bytes)}: choose a smaller depth, a larger voxel size, an automatic depth, or fewer objects"
        )
