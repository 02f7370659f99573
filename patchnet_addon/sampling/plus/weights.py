# SPDX-License-Identifier: GPL-3.0-or-later
"""Weights of the error estimators as plain arrays, all forms in one file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from ...network.weights import Layer, Weights, checked_array, layers_of
from ...runtime.errors import WeightsFileError
from ...runtime.files import content_hash, read_arrays, write_arrays
from .forms import FORMS, Form

KIND = "error-estimators"
HIDDEN = 36  # a multiple of the outputs that the compiled layers sum at once
_of_weights: WeakKeyDictionary[Weights, Estimators] = WeakKeyDictionary()  # which belong to their weights


def layer_sizes(form: Form) -> tuple[int, ...]:
    """Widths of a form's network: its features first, its two outputs last."""
    return (len(form.features), HIDDEN, HIDDEN, 2)


class Network(NamedTuple):
    """Network of a form: linear layers with ReLU between them, of sizes `layer_sizes`.

    Outputs: logarithm of the variance, and mean of the error, both divided by the scale. skip: (F,) float32, linear
    terms of the features in the mean.
    """

    layers: tuple[Layer, ...]
    skip: np.ndarray


@dataclass(frozen=True, eq=False)
class Estimators:
    """Networks of all forms by name.

    metadata: how they were trained, plain JSON values; not part of the hash.
    """

    networks: Mapping[str, Network]
    metadata: dict[str, Any] = field(default_factory=dict)

    @cached_property
    def hash(self) -> str:
        """Hash of all values, by which results name their weights."""
        return content_hash(self.arrays())

    def arrays(self) -> dict[str, np.ndarray]:
        """All arrays by name: plus-0.0.weight, plus-0.0.bias, ..., plus-0.skip, ..."""
        found: dict[str, np.ndarray] = {}
        for form, network in self.networks.items():
            for index, (matrix, bias) in enumerate(network.layers):
                found |= {f"{form}.{index}.weight": matrix, f"{form}.{index}.bias": bias}
            found[f"{form}.skip"] = network.skip
        return found

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray], metadata: dict[str, Any] | None = None) -> Estimators:
        """Inverse of `arrays`; raises KeyError for a missing one and ValueError for a wrong shape or value."""
        return cls({name: _network(arrays, form) for name, form in FORMS.items()}, dict(metadata or {}))


def save_estimators(estimators: Estimators, path: str | Path) -> None:
    """Write estimators to a file; raises OutputError if that fails."""
    write_arrays(path, estimators.arrays(), estimators.metadata | {"features": _features()}, KIND)


def load_estimators(path: str | Path) -> Estimators:
    """Read estimators from a file; raises WeightsFileError."""
    arrays, metadata = read_arrays(path, KIND, WeightsFileError)
    return _checked(arrays, metadata, str(path))


def with_estimators(weights: Weights, estimators: Estimators) -> Weights:
    """PatchNet's weights with the estimators trained on them, for one file."""
    plus = estimators.metadata | {"features": _features()}
    return replace(weights, plus=estimators.arrays(), metadata=weights.metadata | {"plus": plus})


def estimators_of(weights: Weights | None) -> Estimators:
    """Estimators of the PatchNet weights file, else the shipped ones; raises WeightsFileError."""
    if weights is None or not weights.plus:
        return shipped_estimators()
    if weights not in _of_weights:
        metadata = dict(weights.metadata.get("plus", {}))
        _of_weights[weights] = _checked(weights.plus, metadata, "The estimator in the weights file")
    return _of_weights[weights]


def _features() -> dict[str, str]:
    return {name: form.description for name, form in FORMS.items()}


def _checked(arrays: Mapping[str, np.ndarray], metadata: dict[str, Any], path: str) -> Estimators:
    """Estimators with the features of this version; raises WeightsFileError. path: their name in errors."""
    stated = metadata.pop("features", {})
    for name, form in FORMS.items():
        if stated.get(name) != form.description:
            raise WeightsFileError(
                f"{path} was trained on other features of {name!r} than this version has: train it anew with "
                "patchnet lab train-plus"
            )
    try:
        return Estimators.from_arrays(arrays, metadata)
    except KeyError as cause:
        raise WeightsFileError(f"{path} holds other estimators: it lacks '{cause.args[0]}'") from cause
    except ValueError as cause:
        raise WeightsFileError(f"{path} cannot be used: {cause}") from cause


@cache
def shipped_estimators() -> Estimators:
    """Shipped estimators, read once."""
    return load_estimators(Path(__file__).parent / "weights" / "plus.safetensors")


def _network(arrays: Mapping[str, np.ndarray], form: Form) -> Network:
    sizes = layer_sizes(form)
    return Network(layers_of(arrays, form.name, sizes), checked_array(arrays, f"{form.name}.skip", (sizes[0],)))
