# SPDX-License-Identifier: GPL-3.0-or-later
"""Codes of a scene by every network of an evaluation: created once, stored in a file, mapped into memory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
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


def codes_path(folder: Path, weights_hash: str) -> Path:
    """File of a scene's codes by weights of a hash."""
    return folder / f"codes-{weights_hash[:16]}.safetensors"


def kept_codes(octree: Octree, weights: Weights, path: Path) -> Steps[CodedOctree]:
    """Codes by these weights from their file; encodes if it is missing, damaged or of another octree.

    Raises OutputError if it cannot be written, SettingError for an encoder that needs a missing torch.
    """
    try:
        return load_codes(path, octree, weights)
    except CodesFileError:
        path.parent.mkdir(parents=True, exist_ok=True)
        coded = yield from encode_octree(octree, weights, encoder=research_encoder(weights))
        save_codes(coded, path)
        return coded


def coded_octree(path: Path, weights: Weights) -> Steps[CodedOctree]:
    """Octree of a file with its codes, see `kept_codes`."""
    octree = load_octree(path)
    return (
        yield from kept_codes(octree, weights, path.with_name(f"{path.stem}-codes-{weights.hash[:16]}.safetensors"))
    )


@dataclass(frozen=True)
class SceneFiles:
    """Files of a scene for the evaluation of frames.

    codes: file of the codes by `weights`. weights: None for the shipped ones. networks: further networks, whose codes
    are beside that file.
    """

    octree: Path
    codes: Path
    weights: Path | None = None
    networks: tuple[PatchNetwork, ...] = ()

    def codes_of(self, network: PatchNetwork) -> Path:
        """File of the codes by a further network."""
        return codes_path(self.codes.parent, network.hash)

    def pairs(self) -> Iterator[tuple[Path, Path | None]]:
        """Files of codes and of their weights."""
        yield self.codes, self.weights
        yield from ((self.codes_of(network), network.weights) for network in self.networks)


@dataclass(frozen=True, eq=False)
class SceneCodes:
    """Octree with its codes. coded: by the weights of the evaluation. networks: by each further network."""

    coded: CodedOctree
    networks: Mapping[PatchNetwork, CodedOctree]

    def of(self, strategy: Strategy) -> CodedOctree:
        """Octree with the codes of a strategy's network."""
        return self.networks[strategy.network] if isinstance(strategy, NetworkStrategy) else self.coded


def make_codes(files: SceneFiles, octree: Octree) -> Steps[None]:
    """Encode the scene by each network whose codes are missing or damaged."""
    for codes, path in files.pairs():
        yield from kept_codes(octree, load_weights(path), codes)


def load_scene(files: SceneFiles) -> SceneCodes:
    """Read octree and codes; raises PatchNetError for a missing or inconsistent file."""
    octree = load_octree(files.octree)
    coded = load_codes(files.codes, octree, load_weights(files.weights))
    networks = {
        network: load_codes(files.codes_of(network), octree, load_weights(network.weights))
        for network in files.networks
    }
    return SceneCodes(coded, networks)
