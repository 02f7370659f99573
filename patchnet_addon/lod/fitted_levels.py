# SPDX-License-Identifier: GPL-3.0-or-later
"""Levels of leaves that cameras need, and their limit."""

from __future__ import annotations

from dataclasses import dataclass

from ..octree.leaf_levels import LeafLevels

BLOCK_LEVEL = 8  # also the level of invisible leaves
LAYOUT_BYTES = 16 * 8**BLOCK_LEVEL  # data of each block, and further data of fitting
LOOK_AHEAD_SHARE = 0.95  # of the pixels, that a picture should have


@dataclass(frozen=True, eq=False)
class FittedLevels:
    """Levels of the leaves, and their limit.

    wanted: deepest level that the cameras need. leaves: approximate number of leaves. lookahead_share: share of hit
    pixels with look-ahead in the camera with the smallest share; 1 without a limit, if leaves are as deep as all
    cameras need, and None without hits.
    """

    layout: LeafLevels
    wanted: int
    leaves: int
    lookahead_share: float | None
