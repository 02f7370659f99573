# SPDX-License-Identifier: GPL-3.0-or-later
"""Codes of a scene by every network of an evaluation: created once, stored in a file, mapped into memory."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.codes.encode import encode_octree
from ...patchnet_addon.codes.file import load_codes, save_codes
from ...patchnet_addon.network.weights import Weights
from ...patchnet_addon.octree.file import load_octree
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.errors import CodesFileError
from ...patchnet_addon.runtime.progress import Steps
from ...patchnet_addon.sampling.strategy import Strategy
from ..encoders import load_weights
from ..network.research_encoder import research_encoder
from .strategies import NetworkStrategy, PatchNetwork
from .tracks import TrackSettings


def kept_codes(octree: Octree, weights: Weights, folder: Path, name: str = "codes") -> Steps[CodedOctree]:
    """Codes by these weights from their file in `folder`; encodes if it is missing, damaged or of another octree.

    Raises OutputError if it cannot be written, SettingError for an encoder that needs a missing torch.
    """
    path = folder / f"{name}-{weights.hash[:16]}.safetensors"
    try:
        return load_codes(path, octree, weights)
    except CodesFileError:
        folder.mkdir(parents=True, exist_ok=True)
        coded = yield from encode_octree(octree, weights, encoder=research_encoder(weights))
        save_codes(coded, path)
        return coded


def coded_octree(path: Path, weights: Weights) -> Steps[CodedOctree]:
    """Octree of a file with its codes, see `kept_codes`."""
    return (yield from kept_codes(load_octree(path), weights, path.parent, f"{path.stem}-codes"))


@dataclass(frozen=True)
class EvaluationSettings:
    """Settings of an evaluation.

    track: of each scene. weights: file, None for the shipped ones. processes: None for one per core. maps: weights
    files of map networks to evaluate as well. networks: further networks of the kind of `weights`.
    """

    track: TrackSettings
    weights: Path | None = None
    processes: int | None = None
    maps: tuple[Path, ...] = ()
    networks: tuple[PatchNetwork, ...] = ()


@dataclass(frozen=True, eq=False)
class SceneCodes:
    """Octree with its codes. coded: by the weights of the evaluation. networks: by each further network."""

    coded: CodedOctree
    networks: Mapping[PatchNetwork, CodedOctree]

    def of(self, strategy: Strategy) -> CodedOctree:
        """Octree with the codes of a strategy's network."""
        return self.networks[strategy.network] if isinstance(strategy, NetworkStrategy) else self.coded


def scene_codes(octree: Path, folder: Path, settings: EvaluationSettings) -> Steps[SceneCodes]:
    """Octree of a file with its codes by all networks, see `kept_codes`; raises PatchNetError for a missing file."""
    tree = load_octree(octree)
    found = []
    for path in (settings.weights, *(network.weights for network in settings.networks)):
        found.append((yield from kept_codes(tree, load_weights(path), folder)))
    return SceneCodes(found[0], dict(zip(settings.networks, found[1:], strict=True)))
