# SPDX-License-Identifier: GPL-3.0-or-later
"""Sample files: one per octree, which is referenced by path and hash, since it holds the patches."""

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
from ...patchnet_addon.runtime.errors import FileFormatError, PatchNetError, SettingError
from ...patchnet_addon.runtime.files import read_arrays, write_arrays
from ...patchnet_addon.runtime.progress import Steps
from .samples import VIEW_FIELDS, Samples, SampleSettings, draw_samples

KIND = "samples"
SUFFIX = ".samples.safetensors"
DATASET_SEEDS = 1000  # distance between the seeds of two octrees of a data set
_DTYPES = {"voxel": np.uint16, "held_out": np.bool_, "views": np.uint16}


@dataclass(frozen=True, eq=False)
class Dataset:
    """Samples of one octree; `name` identifies them in logs and in metadata of weights.

    With fresh samples (`fresh.py`) a data set has none of its own.
    """

    name: str
    octree: Octree
    samples: Samples
    metadata: dict[str, Any]

    @property
    def lookahead(self) -> int:
        """Levels between the voxels and the cells that their views show; two by default."""
        return int(self.metadata.get("settings", {}).get("lookahead", DEFAULT_LOOKAHEAD))

    @property
    def sample_settings(self) -> SampleSettings:
        """Settings that samples are drawn with; the defaults if the file has none."""
        known = {field.name for field in fields(SampleSettings)}
        stated = self.metadata.get("settings", {})
        return SampleSettings(**{name: value for name, value in stated.items() if name in known})


def fresh_datasets(paths: Sequence[Path], seed: int) -> list[Dataset]:
    """Data sets of octree files for fresh samples, with the held-out parts of `patchnet lab dataset --seed`.

    Raises OctreeFileError for other files.
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
    """Check that names of data sets are unique; raises SettingError."""
    count = Counter(names)
    if twice := sorted(name for name in count if count[name] > 1):
        raise SettingError(f"Two sample files are called {twice[0]}: rename one, or name each file once")


def sample_names(octrees: Sequence[Path]) -> dict[str, Path]:
    """Unique name for each octree: its file's, or its folder's if all files have the same name.

    Names differ by more than case, which some file systems ignore.
    """
    stems = [path.name.removesuffix(".safetensors") for path in octrees]
    if len({stem.casefold() for stem in stems}) < len(stems):
        stems = [f"{path.resolve().parent.name}_{stem}" for path, stem in zip(octrees, stems, strict=True)]
    if len({stem.casefold() for stem in stems}) < len(stems):
        stems = [f"{number}_{stem}" for number, stem in enumerate(stems)]
    return dict(zip(stems, octrees, strict=True))


def draw_dataset(octree_path: Path, count: int, settings: SampleSettings, path: Path) -> Steps[Samples]:
    """Draw at least `count` samples of an octree file into `path`; raises PatchNetError that names the octree."""
    octree = load_octree(octree_path)
    try:
        samples = yield from draw_samples(octree, count, settings, f"Drawing {name_of(path)}")
    except PatchNetError as cause:
        raise type(cause)(f"{octree_path}: {cause}") from cause
    save_samples(samples, octree_path, octree, settings, path)
    return samples


def save_samples(samples: Samples, octree_path: Path, octree: Octree, settings: SampleSettings, path: Path) -> None:
    """Write samples and the path of their octree; raises PatchNetError."""
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

    The octree is searched at its path, then beside the sample file. Raises FileFormatError if a file is missing,
    damaged or changed.
    """
    arrays, metadata = read_arrays(path, KIND, FileFormatError)
    for name, dtype in _DTYPES.items():
        if name not in arrays or arrays[name].dtype != dtype:
            raise FileFormatError(f"{path} is damaged: array '{name}' is missing or has a wrong type; draw it again")
    samples = Samples(**{name: arrays[name] for name in _DTYPES})
    if samples.views.ndim != 3 or samples.views.shape[2] != VIEW_FIELDS or len(samples.voxel) != len(samples.views):
        raise FileFormatError(f"{path} is damaged: its arrays have different lengths; draw it again")
    known = Path(str(metadata.get("octree", "")))
    beside = path.parent / known.name
    octree_path = known if known.is_file() else beside
    octree = load_octree(octree_path)
    if octree_hash(octree) != metadata.get("octree_hash"):
        raise FileFormatError(f"{path} was drawn from another version of {octree_path}: draw it again")
    if octree.leaf_box is not None and not metadata.get("boxes"):
        raise FileFormatError(f"{path} was drawn without the boxes in leaves of {octree_path}: draw it again")
    dataset = Dataset(name_of(path), octree, samples, metadata)
    if dataset.lookahead not in LOOKAHEADS:
        raise FileFormatError(f"{path} looks {dataset.lookahead} levels ahead, which is not supported: draw it again")
    return dataset


def sample_files(paths: list[Path]) -> list[Path]:
    """Sample files, and those in folders; raises FileFormatError for a folder without any."""
    files: list[Path] = []
    for path in paths:
        if path.is_dir():
            found = sorted(path.glob(f"*{SUFFIX}"))
            if not found:
                raise FileFormatError(f"{path} contains no sample files (*{SUFFIX}): run `patchnet lab dataset`")
            files += found
        else:
            files.append(path)
    return files
