# SPDX-License-Identifier: GPL-3.0-or-later
"""Sample files: one per octree, which stays the source of the patches and is found again by path and hash."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..patchnet_addon.octree.file import load_octree, octree_hash
from ..patchnet_addon.octree.octree import Octree
from ..patchnet_addon.runtime.bounds import DEFAULT_LOOKAHEAD, LOOKAHEADS
from ..patchnet_addon.runtime.errors import FileFormatError
from ..patchnet_addon.runtime.files import read_arrays, write_arrays
from .samples import VIEW_FIELDS, Samples, SampleSettings

KIND = "samples"
SUFFIX = ".samples.safetensors"
_DTYPES = {"voxel": np.uint16, "held_out": np.bool_, "views": np.uint16}


@dataclass(frozen=True, eq=False)
class Dataset:
    """Samples of one octree; `name` stands in logs and the model card."""

    name: str
    octree: Octree
    samples: Samples
    metadata: dict[str, Any]

    @property
    def lookahead(self) -> int:
        """Levels between the voxels and the cells that their views saw; two where the file does not say."""
        return int(self.metadata.get("settings", {}).get("lookahead", DEFAULT_LOOKAHEAD))


def save_samples(samples: Samples, octree_path: Path, octree: Octree, settings: SampleSettings, path: Path) -> None:
    """Write samples and where their octree is; raises PatchNetError if they cannot be written."""
    metadata = {
        "octree": str(octree_path.resolve()),
        "octree_hash": octree_hash(octree),
        "settings": asdict(settings),
        "provenance": octree.provenance,
    }
    arrays = {name: getattr(samples, name) for name in _DTYPES}
    write_arrays(path, arrays, metadata, KIND)


def load_dataset(path: Path) -> Dataset:
    """Read a sample file and its octree.

    The octree is looked for where it was, then beside the sample file. Raises FileFormatError if either is missing,
    damaged or changed.
    """
    arrays, metadata = read_arrays(path, KIND, FileFormatError)
    for name, dtype in _DTYPES.items():
        if name not in arrays or arrays[name].dtype != dtype:
            raise FileFormatError(f"{path} is damaged: array '{name}' is missing or of a wrong type; draw it anew")
    samples = Samples(**{name: arrays[name] for name in _DTYPES})
    if samples.views.ndim != 3 or samples.views.shape[2] != VIEW_FIELDS or len(samples.voxel) != len(samples.views):
        raise FileFormatError(f"{path} is damaged: its arrays do not fit together; draw it anew")
    known = Path(str(metadata.get("octree", "")))
    beside = path.parent / known.name
    octree_path = known if known.is_file() else beside
    octree = load_octree(octree_path)
    if octree_hash(octree) != metadata.get("octree_hash"):
        raise FileFormatError(f"{path} was drawn from another state of {octree_path}: draw it anew")
    dataset = Dataset(path.name.removesuffix(SUFFIX), octree, samples, metadata)
    if dataset.lookahead not in LOOKAHEADS:
        raise FileFormatError(f"{path} looks {dataset.lookahead} levels ahead, which is not known: draw it anew")
    return dataset


def sample_files(paths: list[Path]) -> list[Path]:
    """Sample files named, and those in the folders named; raises FileFormatError if a folder holds none."""
    files: list[Path] = []
    for path in paths:
        if path.is_dir():
            found = sorted(path.glob(f"*{SUFFIX}"))
            if not found:
                raise FileFormatError(f"{path} holds no sample files (*{SUFFIX}): run `patchnet dataset`")
            files += found
        else:
            files.append(path)
    return files
