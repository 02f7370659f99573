# SPDX-License-Identifier: GPL-3.0-or-later
"""Weights of the error estimators as plain arrays, all forms in one file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ...runtime.errors import WeightsFileError
from ...runtime.files import content_hash, read_arrays, write_arrays
from .forms import FORMS, Form

KIND = "error-estimators"
HIDDEN = 36  # a multiple of the outputs that the compiled layers sum at once

Layer = tuple[np.ndarray, np.ndarray]
"""Matrix (out, in) and bias (out,), float32."""


def layer_sizes(form: Form) -> tuple[int, ...]:
    """Values between the layers of a form's network, its features first."""
    return (len(form.features), HIDDEN, HIDDEN, 1)


@dataclass(frozen=True, eq=False)
class Estimators:
    """Networks of all forms: linear layers with ReLU between them, of sizes `layer_sizes`.

    layers: by the form's name. metadata: how they were trained, plain JSON values; not part of the hash.
    """

    layers: Mapping[str, tuple[Layer, ...]]
    metadata: dict[str, Any] = field(default_factory=dict)

    @cached_property
    def hash(self) -> str:
        """Hash of all values: results name the weights they were made with."""
        return content_hash(self.arrays())

    def arrays(self) -> dict[str, np.ndarray]:
        """All arrays by name: plus-0.0.weight, plus-0.0.bias, ..."""
        return {
            f"{form}.{index}.{name}": array
            for form, layers in self.layers.items()
            for index, layer in enumerate(layers)
            for name, array in zip(("weight", "bias"), layer, strict=True)
        }

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray], metadata: dict[str, Any] | None = None) -> Estimators:
        """Inverse of `arrays`; raises KeyError for a missing one and ValueError for a wrong shape or value."""
        layers = {name: _layers(arrays, form) for name, form in FORMS.items()}
        return cls(layers, dict(metadata or {}))

    @classmethod
    def random(cls, seed: int = 0) -> Estimators:
        """Untrained weights, for tests."""
        random = np.random.default_rng(seed)

        def layers(sizes: tuple[int, ...]) -> tuple[Layer, ...]:
            return tuple(
                (
                    (random.standard_normal((after, before)) * before**-0.5).astype(np.float32),
                    (random.standard_normal(after) * 0.1).astype(np.float32),
                )
                for before, after in zip(sizes, sizes[1:], strict=False)
            )

        return cls({name: layers(layer_sizes(form)) for name, form in FORMS.items()}, {"random_seed": seed})


def save_estimators(estimators: Estimators, path: str | Path) -> None:
    """Write estimators to a file; raises OutputError if that fails."""
    features = {name: form.description for name, form in FORMS.items()}
    write_arrays(path, estimators.arrays(), estimators.metadata | {"features": features}, KIND)


def load_estimators(path: str | Path) -> Estimators:
    """Read estimators from a file; raises WeightsFileError."""
    arrays, metadata = read_arrays(path, KIND, WeightsFileError)
    stated = metadata.pop("features", {})
    for name, form in FORMS.items():
        if stated.get(name) != form.description:
            raise WeightsFileError(
                f"{path} was trained on other features of {name!r} than this version has: train it anew with "
                "patchnet train-plus"
            )
    try:
        return Estimators.from_arrays(arrays, metadata)
    except KeyError as cause:
        raise WeightsFileError(f"{path} holds other estimators: it lacks '{cause.args[0]}'") from cause
    except ValueError as cause:
        raise WeightsFileError(f"{path} cannot be used: {cause}") from cause


@cache
def shipped_estimators() -> Estimators:
    """Estimators that are shipped, read once."""
    return load_estimators(shipped_path())


def shipped_path() -> Path:
    """File of the estimators that are shipped."""
    return Path(__file__).parent / "weights" / "plus.safetensors"


def _layers(arrays: Mapping[str, np.ndarray], form: Form) -> tuple[Layer, ...]:
    sizes = layer_sizes(form)
    return tuple(
        (
            _checked(arrays, f"{form.name}.{index}.weight", (sizes[index + 1], sizes[index])),
            _checked(arrays, f"{form.name}.{index}.bias", (sizes[index + 1],)),
        )
        for index in range(len(sizes) - 1)
    )


def _checked(arrays: Mapping[str, np.ndarray], name: str, shape: tuple[int, ...]) -> np.ndarray:
    array = arrays[name]
    if array.shape != shape or array.dtype != np.float32:
        raise ValueError(
            f"'{name}' is {array.dtype} of shape {array.shape} where this version has float32 of shape {shape}"
        )
    if not np.isfinite(array).all():
        raise ValueError(f"'{name}' holds values that are not finite")
    return np.array(array, order="C")
