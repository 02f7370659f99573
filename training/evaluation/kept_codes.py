# SPDX-License-Identifier: GPL-3.0-or-later
"""Codes of an octree from a file, where they are kept for the next evaluation."""

from __future__ import annotations

from pathlib import Path

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.codes.encode import encode_octree
from ...patchnet_addon.codes.file import load_codes, save_codes
from ...patchnet_addon.network.weights import Weights
from ...patchnet_addon.octree.file import load_octree
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.errors import CodesFileError
from ...patchnet_addon.runtime.progress import Steps
from ..network.research_encoder import research_encoder


def codes_path(folder: Path, weights_hash: str) -> Path:
    """File in a scene's folder of its codes by the weights of a hash."""
    return folder / f"codes-{weights_hash[:16]}.safetensors"


def kept_codes(octree: Octree, weights: Weights, path: Path) -> Steps[CodedOctree]:
    """Codes by these weights from their file, which is made if it is missing, damaged or of another octree.

    Raises OutputError if it cannot be written, SettingError for an encoder that needs torch where there is none.
    """
    try:
        return load_codes(path, octree, weights)
    except CodesFileError:
        path.parent.mkdir(parents=True, exist_ok=True)
        coded = yield from encode_octree(octree, weights, encoder=research_encoder(weights))
        save_codes(coded, path)
        return coded


def coded_octree(path: Path, weights: Weights) -> Steps[CodedOctree]:
    """Octree of a file with codes that are kept beside it, see `kept_codes`."""
    octree = load_octree(path)
    return (
        yield from kept_codes(octree, weights, path.with_name(f"{path.stem}-codes-{weights.hash[:16]}.safetensors"))
    )
