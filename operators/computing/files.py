# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of a job that the engine reads."""

from __future__ import annotations

from pathlib import Path

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.codes.file import load_codes
from ...patchnet_addon.network.weights import Weights
from ...patchnet_addon.octree.file import load_octree
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.errors import CodesFileError

_CODES = "codes.safetensors"  # beside the octree, written by the same job


def loaded_files(path: Path, weights: Weights) -> tuple[Octree, CodedOctree | None, str]:
    """Load the octree and its codes, with a sentence if these are of other weights."""
    octree = load_octree(path)
    if not path.with_name(_CODES).exists():
        return octree, None, ""
    try:
        return octree, load_codes(path.with_name(_CODES), octree, weights), ""
    except CodesFileError as error:
        return octree, None, str(error)
