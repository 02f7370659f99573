# SPDX-License-Identifier: GPL-3.0-or-later
"""Time of opening an octree file beside reading the same arrays with `numpy.load` from an uncompressed .npz.

Ours maps the file into memory, compares the header and every array with their checksums, and checks that all levels
and child indices are consistent. NumPy copies the arrays into memory; its zip reader compares them with checksums too.
Both files were read just before, so that they lie in the system's file cache: a disk is not measured.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from ...patchnet_addon.octree.file import KIND, load_octree, octree_arrays
from ...patchnet_addon.runtime.errors import OctreeFileError
from ...patchnet_addon.runtime.files import read_arrays
from .timing import Comparison, compare, take_turns


def benchmark_opening(path: Path, folder: Path, repeats: int = 7) -> Comparison:
    """Wall seconds to open the octree file `path` with all cores; the peer's file is made in `folder`.

    Raises OctreeFileError if the file cannot be read.
    """
    octree = load_octree(path)
    arrays = octree_arrays(octree)
    theirs = folder / "peer.npz"
    np.savez(theirs, **arrays)  # type: ignore[arg-type]
    _read_npz(theirs)
    comparison = compare("open", lambda: load_octree(path), lambda: _read_npz(theirs), repeats, all_cores=True)
    parts = take_turns(
        {"map": lambda: _read(path, verify=False), "map_and_checksums": lambda: _read(path, verify=True)},
        repeats,
        all_cores=True,
    )
    details = comparison.details | {
        "nodes": octree.node_count,
        "leaves": octree.leaf_count,
        "depth": octree.depth,
        "file_bytes": path.stat().st_size,
        "peer_bytes": theirs.stat().st_size,
        "peer_name": f"NumPy {np.__version__} np.load of .npz",
        "checked": "header, CRC-32 of each array, levels and child indices",
        "cache": "warm",
        "map_s": median(parts["map"]),
        "map_and_checksums_s": median(parts["map_and_checksums"]),
    }
    return replace(comparison, details=details)


def _read(path: Path, verify: bool) -> dict[str, np.ndarray]:
    return read_arrays(path, KIND, OctreeFileError, verify=verify)[0]


def _read_npz(path: Path) -> dict[str, Any]:
    with np.load(path, allow_pickle=False) as file:
        return {name: file[name] for name in file.files}
