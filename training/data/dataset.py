# SPDX-License-Identifier: GPL-3.0-or-later
"""Sample files: one per octree, which stays the source of the patches and is found again by path and hash."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from ...patchnet_addon.octree.file import load_octree, octree_hash
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.bounds import DEFAULT_LOOKAHEAD, LOOKAHEADS
from ...patchnet_addon.runtime.errors import FileFormatError, SettingError
from ...patchnet_addon.runtime.files import read_arrays, write_arrays
from .samples import VIEW_FIELDS, Samples, SampleSettings

KIND = "samples"
SUFFIX = ".samples.safetensors"
DATASET_SEEDS = 1000  # between the seeds of two octrees of a data set
_DTYPES = {"voxel": np.uint16, "held_out": np.bool_, "views": np.uint16}


@dataclass(frozen=True, eq=False)
class Dataset:
    """Samples of one octree; `name` stands in logs and the model card.

    Those of a run that draws fresh samples (`fresh.py`) hold none of their own.
    """

    name: str
    octree: Octree
    samples: Samples
    metadata: dict[str, Any]

    @property
    def lookahead(self) -> int:
        """Levels between the voxels and the cells that their views saw; two where the file does not say."""
        return int(self.metadata.get("settings", {}).get("lookahead", DEFAULT_LOOKAHEAD))

    @property
    def sample_settings(self) -> SampleSettings:
        """Settings that samples are drawn with; the usual ones where the file does not say."""
        known = {field.name for field in fields(SampleSettings)}
        stated = self.metadata.get("settings", {})
        return SampleSettings(**{name: value for name, value in stated.items() if name in known})

    @property
    def is_fresh(self) -> bool:
        """Whether its samples are drawn by each step anew."""
        return bool(self.metadata.get("fresh"))


def fresh_datasets(paths: Sequence[Path], seed: int) -> list[Dataset]:
    """Data sets of octree files that samples are drawn from anew, held-out parts as of `patchnet lab dataset --seed`.

    Raises OctreeFileError for files that are no octrees.
    """
    datasets = []
    for number, (name, path) in enumerate(sample_names(paths).items()):
        settings = SampleSettings(seed=seed + DATASET_SEEDS * number)
        shape = 0, settings.views, VIEW_FIELDS
        none = Samples(np.zeros((0, 4), np.uint16), np.zeros(0, np.bool_), np.zeros(shape, np.uint16))
        datasets.append(Dataset(name, load_octree(path), none, {"settings": asdict(settings), "fresh": True}))
    return datasets


def name_of(path: Path) -> str:
    """Name of the data set in a sample file."""
    return path.name.removesuffix(SUFFIX)


def check_names(names: Iterable[str]) -> None:
    """Check that data sets can be told apart in logs and tables; raises SettingError."""
    count = Counter(names)
    if twice := sorted(name for name in count if count[name] > 1):
        raise SettingError(f"Two sample files are called {twice[0]}: rename one, or name each file once")


def sample_names(octrees: Sequence[Path]) -> dict[str, Path]:
    """Choose a different name for each octree: its file's, or its folder's where files are all called alike.

    Names differ by more than the case of letters, which some file systems do not tell apart.
    """
    stems = [path.name.removesuffix(".safetensors") for path in octrees]
    if len({stem.casefold() for stem in stems}) < len(stems):
        stems = [f"{path.resolve().parent.name}_{stem}" for path, stem in zip(octrees, stems, strict=True)]
    if len({stem.casefold() for stem in stems}) < len(stems):
        stems = [f"{number}_{stem}" for number, stem in enumerate(stems)]
    return dict(zip(stems, octrees, strict=True))


def save_samples(samples: Samples, octree_path: Path, octree: Octree, settings: SampleSettings, path: Path) -> None:
    """Write samples and where their octree is; raises PatchNetError if they cannot be written."""
    metadata = {
        "octree": str(octree_path.resolve()),
        "octree_hash": octree_hash(octree),
        "boxes": octree.leaf_box is not None,
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
    if octree.leaf_box is not None and not metadata.get("boxes"):
        raise FileFormatError(f"{path} saw the leaves of {octree_path} as whole voxels: draw it anew")
    dataset = Dataset(name_of(path), octree, samples, metadata)
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
                raise FileFormatError(f"{path} holds no sample files (*{SUFFIX}): run `patchnet lab dataset`")
            files += found
        else:
            files.append(path)
    return files
