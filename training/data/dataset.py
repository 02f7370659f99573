# SPDX-License-Identifier: GPL-3.0-or-later
"""Sample files: one per octree, which is referenced by path and hash, since it holds the patches.

A data set's error may be reported as that of an unseen scene if its scene is not in training in any pose, light or part
(methods 7.21): a rotated octree shows the same shapes. Scenes are compared by the provenance of their octrees; in doubt
they count as the same.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...patchnet_addon.octree.file import load_octree, octree_hash
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.errors import FileFormatError, PatchNetError, SettingError
from ...patchnet_addon.runtime.files import read_arrays, write_arrays
from ...patchnet_addon.runtime.progress import Steps
from .samples import VIEW_FIELDS, Samples, draw_samples
from .voxel_choice import SampleSettings

KIND = "samples"
SUFFIX = ".samples.safetensors"
DATASET_SEEDS = 1000  # distance between the seeds of two octrees of a data set


@dataclass(frozen=True, eq=False)
class Dataset:
    """Samples of one octree; `name` identifies them in logs and in metadata of weights.

    With fresh samples (`corpus.py`) a data set has none of its own.
    """

    name: str
    octree: Octree
    samples: Samples
    metadata: dict[str, Any]

    @property
    def lookahead(self) -> int:
        """Levels between the voxels and the cells that their views show; two by default."""
        return self.sample_settings.lookahead

    @property
    def sample_settings(self) -> SampleSettings:
        """Settings that samples are drawn with; the defaults if the file has none."""
        return SampleSettings(**self.metadata.get("settings", {}))


def fresh_datasets(paths: Sequence[Path], seed: int) -> list[Dataset]:
    """Data sets of octree files for fresh samples, parts held out as by `lab dataset`; raises OctreeFileError."""
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
    write_arrays(path, vars(samples), metadata, KIND)


def load_dataset(path: Path) -> Dataset:
    """Read a sample file and its octree.

    The octree is searched at its path, then beside the sample file. Raises FileFormatError if a file is missing,
    damaged or changed.
    """
    arrays, metadata = read_arrays(path, KIND, FileFormatError)
    known = Path(str(metadata.get("octree", "")))
    beside = path.parent / known.name
    octree_path = known if known.is_file() else beside
    octree = load_octree(octree_path)
    if octree_hash(octree) != metadata.get("octree_hash"):
        raise FileFormatError(f"{path} was drawn from another version of {octree_path}: draw it again")
    if octree.leaf_box is not None and not metadata.get("boxes"):
        raise FileFormatError(f"{path} was drawn without the boxes in leaves of {octree_path}: draw it again")
    return Dataset(name_of(path), octree, Samples(**arrays), metadata)


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


def scene_of(dataset: Dataset) -> str:
    """File of a data set's scene, else the name of the scene; empty if its octree has neither."""
    made = dataset.octree.provenance
    return Path(str(made.get("file") or made.get("scene") or "")).name


def why_not_held_out(dataset: Dataset, training: Sequence[Dataset]) -> str:
    """Reason why the scene of `dataset` is not held out of `training`; empty if it is.

    File names are compared without case and ending, so that a scene in another file format counts as the same.
    """
    scene = scene_of(dataset)
    if not scene:
        return f"not held out: the octree of {dataset.name} does not say its scene, which may be in training"
    if any(_key(scene_of(other)) == _key(scene) for other in training):
        return f"not held out: {scene} is in training"
    unknown = [other.name for other in training if not scene_of(other)]
    if unknown:
        return f"not held out: the octree of {unknown[0]} in training does not say its scene, which may be {scene}"
    return ""


def _key(scene: str) -> str:
    return Path(scene).stem.casefold()
