# SPDX-License-Identifier: GPL-3.0-or-later
"""Codes of an octree from a folder, where they are kept for the next evaluation."""

from __future__ import annotations

from pathlib import Path

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.codes.encode import encode_octree
from ...patchnet_addon.codes.file import load_codes, save_codes
from ...patchnet_addon.network.weights import Weights
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.errors import CodesFileError
from ...patchnet_addon.runtime.progress import Steps


def kept_codes(octree: Octree, weights: Weights, folder: Path) -> Steps[CodedOctree]:
    """Codes by these weights from their file in `folder`, which is made if it is missing, damaged or of another octree.

    Raises OutputError if it cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"codes-{weights.hash[:16]}.safetensors"
    try:
        return load_codes(path, octree, weights)
    except CodesFileError:
        coded = yield from encode_octree(octree, weights)
        save_codes(coded, path)
        return coded
