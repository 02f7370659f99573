# SPDX-License-Identifier: GPL-3.0-or-later
"""Codes file beside the octree's; it names its octree and weights."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..network.kinds import CODE_SIZE, CORNERS
from ..network.weights import Weights
from ..octree.file import octree_hash
from ..octree.octree import Octree
from ..runtime.errors import CodesFileError
from ..runtime.files import read_arrays, write_arrays
from .coded_octree import CodedOctree
from .corner_rows import COLUMNS, coded_nodes, last_row

KIND = "codes"
_VERSION = 3  # of order, index and inputs of codes; files of version 1 do not state it


def save_codes(coded: CodedOctree, path: str | Path) -> None:
    """Write the codes, not the octree; raises PatchNetError if that fails."""
    metadata = {
        "codes_version": _VERSION,
        "octree_hash": octree_hash(coded.octree),
        "weights_hash": coded.weights.hash,
        "look_ahead": coded.weights.lookahead,
        "depth": coded.octree.depth,
    }
    arrays = {"codes": coded.codes, "corner_rows": coded.corner_rows}
    if coded.corner_cells is not None:
        arrays["corner_cells"] = coded.corner_cells
    write_arrays(path, arrays, metadata, KIND)


def load_codes(path: str | Path, octree: Octree, weights: Weights) -> CodedOctree:
    """Read codes of `octree` and `weights`; raises CodesFileError for codes of others, and for a damaged file."""
    arrays, metadata = read_arrays(path, KIND, CodesFileError)
    version = metadata.get("codes_version", 1)
    if version != _VERSION:
        age = "an older" if version in range(1, _VERSION) else "a newer"
        raise CodesFileError(
            f"{path} was written by {age} PatchNet (codes version {version}, this one reads {_VERSION}): "
            "precompute the codes again"
        )
    if metadata.get("octree_hash") != octree_hash(octree):
        raise CodesFileError(f"{path} belongs to another octree: precompute the codes for this one")
    if metadata.get("weights_hash") != weights.hash:
        raise CodesFileError(
            f"{path} was made with other weights ({metadata.get('weights_hash')}) than those in use ({weights.hash}): "
            "precompute the codes again, or choose the weights that made them"
        )
    nodes, count = coded_nodes(octree, weights.lookahead)
    codes, rows, around = (arrays.get(name) for name in ("codes", "corner_rows", "corner_cells"))
    if (
        codes is None
        or rows is None
        or (codes.dtype, codes.shape[1:]) != (np.float16, (CODE_SIZE,))
        or (rows.dtype, rows.shape) != (np.uint32, (count, COLUMNS))
        or last_row(rows) >= len(codes)
        or (around is not None) != weights.kind.mixes
        or (around is not None and (around.dtype, around.shape) != (np.uint32, (len(codes), CORNERS)))
    ):
        raise CodesFileError(f"{path} is damaged: its codes do not fit its octree; precompute the codes again")
    return CodedOctree(octree, weights, codes, rows, nodes, around)
