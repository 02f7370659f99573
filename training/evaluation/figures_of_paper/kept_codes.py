# SPDX-License-Identifier: GPL-3.0-or-later
"""Codes of an octree file, made once and kept beside it."""

from __future__ import annotations

from pathlib import Path

from ....patchnet_addon.codes.coded_octree import CodedOctree
from ....patchnet_addon.codes.encode import encode_octree
from ....patchnet_addon.codes.file import load_codes, save_codes
from ....patchnet_addon.network.weights import Weights
from ....patchnet_addon.octree.file import load_octree
from ....patchnet_addon.runtime.errors import CodesFileError
from ....patchnet_addon.runtime.progress import Steps


def coded_octree(path: Path, weights: Weights) -> Steps[CodedOctree]:
    """Octree of a file with codes of `weights`, from a file beside it where these are there already."""
    octree = load_octree(path)
    file = path.with_name(f"{path.stem}-codes-{weights.hash[:16]}.safetensors")
    try:
        return load_codes(file, octree, weights)
    except CodesFileError:
        coded = yield from encode_octree(octree, weights)
        save_codes(coded, file)
        return coded
