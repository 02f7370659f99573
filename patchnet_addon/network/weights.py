# SPDX-License-Identifier: GPL-3.0-or-later
"""Weights of PatchNet as plain arrays, and their file."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ..runtime.bounds import DECODER_WIDTH, DEFAULT_LOOKAHEAD, ENCODER_WIDTH, LOOKAHEAD, LOOKAHEADS, Bounds
from ..runtime.errors import WeightsFileError
from ..runtime.files import content_hash, read_arrays, write_arrays
from .encoders import CHANNELS as CHANNELS
from .encoders import MLP, MLP_WIDTH_STEP, EncoderKind, patch_side
from .kinds import KINDS, PAPER, WIDTH_STEP, NetworkKind

MODULATED = 9  # dimensions of a code that harmonics of degree 0 to 2 are multiplied into (methods 7.13)
KIND = "weights"
_ENCODERS = {MLP.name: MLP}  # of the engine
_PLUS = "plus."  # prefix of an estimator's arrays
_Kind = TypeVar("_Kind")
Layer = tuple[np.ndarray, np.ndarray]
"""Matrix (out, in), or kernels (out, in, z, y, x), and bias (out,), float32."""


def network(lookahead: int, kind: NetworkKind = PAPER, encoder: EncoderKind = MLP) -> dict[str, Any]:
    """Conventions of the numbers, beyond their shapes, which a file states; files with others are rejected.

    The defaults of files are the paper's kind and the paper's encoder.
    """
    side = patch_side(lookahead)
    encoding = {} if encoder.name == MLP.name else {"encoder": encoder.name, "encoder_layers": encoder.text}
    return (
        ({} if kind is PAPER else {"kind": kind.name})
        | encoding
        | {
            "look_ahead": lookahead,
            "patch": f"{side} cells a side; order z, y, x, channel; channels occupancy, luminance, normal x, y, z",
            "corners": "order x, y, z, x fastest; trilinear",
            "decoder_inputs": kind.inputs,
            "modulation": "code dimensions 0 to 8 times harmonics 0 to 8, in place",
            "output": kind.output,
        }
    )


@dataclass(frozen=True, eq=False)
class Weights:
    """Layers of encoder and decoder, ReLU between them.

    encoder: layers of the sizes of `encoder_kind`; input order z, y, x, channel of a patch, 8x8x8x5 for two levels
    (methods 7.9).
    decoder: linear layers, sizes and order of inputs of its kind (`kinds.py`).
    metadata: how the weights were trained, plain JSON values; not part of the hash.
    plus: arrays of an estimator of pixel errors that has learned from these weights (methods 12), with its metadata in
    `metadata["plus"]`; empty for none. Not part of the hash, since codes do not depend on it.
    """

    encoder: tuple[Layer, ...]
    decoder: tuple[Layer, ...]
    metadata: dict[str, Any] = field(default_factory=dict)
    encoder_kind: EncoderKind = MLP
    plus: Mapping[str, np.ndarray] = field(default_factory=dict)

    @property
    def lookahead(self) -> int:
        """Levels that the network looks ahead, 1 to 3: patches of so many cells are what its encoder takes."""
        shapes = tuple(matrix.shape for matrix, _ in self.encoder)
        return next(lookahead for lookahead in LOOKAHEADS if self.encoder_kind.shapes(lookahead) == shapes)

    @property
    def kind(self) -> NetworkKind:
        """Kind of network, by the sizes of its decoder."""
        sizes = (self.decoder[0][0].shape[1], *(len(bias) for _, bias in self.decoder))
        kinds = (kind.of_width(sizes[1]) if kind.mixes else kind for kind in KINDS.values())
        return next(kind for kind in kinds if kind.decoder == sizes)

    @cached_property
    def hash(self) -> str:
        """Hash of all values: codes and reports name the weights they were made with."""
        return content_hash(self.arrays())

    @property
    def whole_hash(self) -> str:
        """Hash of all values, those of the estimator among them: rankings depend on both."""
        return content_hash(self.arrays() | _named_plus(self.plus)) if self.plus else self.hash

    def arrays(self) -> dict[str, np.ndarray]:
        """Arrays of the network by name: encoder.0.weight, encoder.0.bias, ..., decoder.3.bias."""
        parts = {"encoder": self.encoder, "decoder": self.decoder}
        return {
            f"{part}.{index}.{name}": array
            for part, layers in parts.items()
            for index, layer in enumerate(layers)
            for name, array in zip(("weight", "bias"), layer, strict=True)
        }

    @classmethod
    def from_arrays(
        cls,
        arrays: dict[str, np.ndarray],
        metadata: dict[str, Any] | None = None,
        lookahead: int = DEFAULT_LOOKAHEAD,
        kind: NetworkKind = PAPER,
        encoder: EncoderKind = MLP,
    ) -> Weights:
        """Inverse of `arrays`; raises KeyError for a missing one and ValueError for a wrong shape or value.

        Decoders of a kind that has several widths, and the encoder `mlp`, may have any of theirs.
        """
        if encoder.width:
            encoder = encoder.of_width(_width_of(arrays, "encoder", MLP_WIDTH_STEP, ENCODER_WIDTH))
        layers = _shaped_layers(arrays, "encoder", encoder.shapes(lookahead))
        if kind.mixes:
            kind = kind.of_width(_width_of(arrays, "decoder", WIDTH_STEP, DECODER_WIDTH))
        plus = {name.removeprefix(_PLUS): array for name, array in arrays.items() if name.startswith(_PLUS)}
        return cls(layers, layers_of(arrays, "decoder", kind.decoder), dict(metadata or {}), encoder, plus)

    @classmethod
    def random(
        cls,
        seed: int = 0,
        bias: float = 0.0,
        lookahead: int = DEFAULT_LOOKAHEAD,
        kind: NetworkKind = PAPER,
        encoder: EncoderKind = MLP,
    ) -> Weights:
        """Untrained weights: He initialisation (methods 7.21), biases normal with deviation `bias`.

        An encoder that sees shape alone has zeros where it would see luminance. Raises SettingError for a look-ahead
        that is not 1, 2 or 3.
        """
        LOOKAHEAD.check(lookahead)
        random = np.random.default_rng(seed)

        def layers(shapes: Iterable[tuple[int, ...]]) -> tuple[Layer, ...]:
            return tuple(
                (
                    (random.standard_normal(shape) * (2 / math.prod(shape[1:])) ** 0.5).astype(np.float32),
                    (random.standard_normal(shape[0]) * bias).astype(np.float32),
                )
                for shape in shapes
            )

        first = layers(encoder.shapes(lookahead))
        last = layers((after, before) for before, after in pairwise(kind.decoder))
        if kind.mixes:
            encoder.hide_luminance(first, lookahead)
        return cls(first, last, {"random_seed": seed}, encoder)


def _named_plus(plus: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {f"{_PLUS}{name}": array for name, array in plus.items()}


def save_weights(weights: Weights, path: str | Path) -> None:
    """Write weights to a file; raises PatchNetError if that fails."""
    stated = network(weights.lookahead, weights.kind, weights.encoder_kind)
    write_arrays(path, weights.arrays() | _named_plus(weights.plus), {**weights.metadata, "network": stated}, KIND)


def load_weights(path: str | Path | None = None, encoders: Mapping[str, EncoderKind] = _ENCODERS) -> Weights:
    """Read weights from a file, or the shipped ones; raises WeightsFileError.

    encoders: accepted encoders by name; the engine implements `mlp` only.
    """
    path = Path(path) if path is not None else default_weights_path()
    arrays, metadata = read_arrays(path, KIND, WeightsFileError)
    stated = {"look_ahead": DEFAULT_LOOKAHEAD, **metadata.pop("network", {})}
    lookahead = _known_one({each: each for each in LOOKAHEADS}, stated, "look_ahead", DEFAULT_LOOKAHEAD, path)
    kind = _known_one(KINDS, stated, "kind", PAPER.name, path)
    encoder = _known_encoder(encoders, stated, path)
    here = network(lookahead, kind, encoder)
    if stated != here:
        other = next(name for name in {**here, **stated} if stated.get(name) != here.get(name))
        raise WeightsFileError(
            f"{path} belongs to another network: its '{other}' is {stated.get(other)!r} where this one has "
            f"{here.get(other)!r}"
        )
    try:
        return Weights.from_arrays(arrays, metadata, lookahead, kind, encoder)
    except KeyError as cause:
        raise WeightsFileError(f"{path} belongs to another network: it lacks '{cause.args[0]}'") from cause
    except ValueError as cause:
        raise WeightsFileError(f"{path} cannot be used: {cause}") from cause


def _known_one(known: Mapping[Any, _Kind], stated: Mapping[str, Any], what: str, default: Any, path: Path) -> _Kind:
    """Kind that a file states as `what`; raises WeightsFileError for one that is not known."""
    name = stated.get(what, default)
    if type(name) is not type(default) or name not in known:  # true is no number
        raise WeightsFileError(
            f"{path} belongs to another network: its '{what}' is {name!r} where this one has one of "
            f"{', '.join(map(str, known))}"
        )
    return known[name]


def _known_encoder(encoders: Mapping[str, EncoderKind], stated: Mapping[str, Any], path: Path) -> EncoderKind:
    """Encoder that a file states; raises WeightsFileError for one that is not known."""
    name = stated.get("encoder", MLP.name)
    if encoders is _ENCODERS and name != MLP.name:
        raise WeightsFileError(
            f"{path} has the encoder {name!r}, which research commands alone run: choose weights with the encoder "
            f"'{MLP.name}', such as those that are shipped"
        )
    return _known_one(encoders, stated, "encoder", MLP.name, path)


def default_weights_path() -> Path:
    """File of the shipped weights."""
    return Path(__file__).parent / "weights" / "patchnet.safetensors"


def layers_of(arrays: Mapping[str, np.ndarray], part: str, sizes: tuple[int, ...]) -> tuple[Layer, ...]:
    """Linear layers PART.0.weight, PART.0.bias, ... with `sizes` values between them.

    Raises KeyError for a missing one and ValueError for a wrong shape or value.
    """
    return _shaped_layers(arrays, part, tuple((after, before) for before, after in pairwise(sizes)))


def _width_of(arrays: Mapping[str, np.ndarray], part: str, step: int, bounds: Bounds) -> int:
    """Width of an encoder or decoder by its first bias; raises ValueError for one that kernels do not know."""
    name = f"{part}.0.bias"
    bias = arrays[name]
    if bias.ndim != 1 or bias.size % step or not bounds.low <= bias.size <= bounds.high:
        raise ValueError(
            f"'{name}' has the shape {bias.shape} where {part}s have a multiple of {step} numbers, "
            f"{bounds.low} to {bounds.high}"
        )
    return bias.size


def _shaped_layers(
    arrays: Mapping[str, np.ndarray], part: str, shapes: tuple[tuple[int, ...], ...]
) -> tuple[Layer, ...]:
    """Layers PART.0.weight, PART.0.bias, ... of these shapes; raises as `layers_of`."""
    return tuple(
        (
            checked_array(arrays, f"{part}.{index}.weight", shape),
            checked_array(arrays, f"{part}.{index}.bias", shape[:1]),
        )
        for index, shape in enumerate(shapes)
    )


def checked_array(arrays: Mapping[str, np.ndarray], name: str, shape: tuple[int, ...]) -> np.ndarray:
    """Copy of a float32 array of a file; raises as `layers_of`."""
    array = arrays[name]
    if array.shape != shape or array.dtype != np.float32:
        raise ValueError(
            f"'{name}' is {array.dtype} of shape {array.shape} where this network has float32 of shape {shape}"
        )
    if not np.isfinite(array).all():
        raise ValueError(f"'{name}' holds values that are not finite")
    return np.array(array, order="C")
