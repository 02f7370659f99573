# SPDX-License-Identifier: GPL-3.0-or-later
"""Codes file, which stands beside the octree's and names the octree and the weights it belongs to."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..network.weights import CODE_SIZE, Weights
from ..octree.file import octree_hash
from ..octree.octree import Octree
from ..runtime.errors import CodesFileError
from ..runtime.files import read_arrays, write_arrays
from .coded_octree import CodedOctree

KIND = "codes"


def save_codes(coded: CodedOctree, path: str | Path) -> None:
    """Write the codes, not the octree; raises PatchNetError if that fails."""
    metadata = {
        "octree_hash": octree_hash(coded.octree),
        "weights_hash": coded.weights_hash,
        "look_ahead": coded.weights.lookahead,
        "depth": coded.octree.depth,
    }
    write_arrays(path, {"codes": coded.codes, "node_corners": coded.node_corners}, metadata, KIND)


def load_codes(path: str | Path, octree: Octree, weights: Weights) -> CodedOctree:
    """Read codes that were made for `octree` with `weights`; raises CodesFileError if they were not, or on damage."""
    arrays, metadata = read_arrays(path, KIND, CodesFileError)
    if metadata.get("octree_hash") != octree_hash(octree):
        raise CodesFileError(f"{path} belongs to another octree: precompute the codes for this one")
    if metadata.get("weights_hash") != weights.hash:
        raise CodesFileError(
            f"{path} was made with other weights ({metadata.get('weights_hash')}) than those in use ({weights.hash}): "
            "precompute the codes again, or choose the weights that made them"
        )
    codes, node_corners = arrays.get("codes"), arrays.get("node_corners")
    count = int(np.count_nonzero(octree.look_ahead(weights.lookahead)))
    if (
        codes is None
        or node_corners is None
        or (codes.dtype, codes.shape[1:]) != (np.float16, (CODE_SIZE,))
        or (node_corners.dtype, node_corners.shape) != (np.uint32, (count, 8))
        or (count > 0 and int(node_corners.max()) >= len(codes))
    ):
        raise CodesFileError(f"{path} is damaged: its codes do not fit its octree; precompute the codes again")
    return CodedOctree(octree, weights, codes, node_corners)
