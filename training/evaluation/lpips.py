# SPDX-License-Identifier: GPL-3.0-or-later
"""LPIPS v0.1 with AlexNet, by weights that users supply, since PatchNet cannot distribute them (methods 5).

Zhang, Isola, Efros, Shechtman, Wang, "The Unreasonable Effectiveness of Deep Features as a Perceptual Metric", CVPR
2018; AlexNet is that of Krizhevsky, "One weird trick for parallelizing convolutional neural networks", 2014.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from ...patchnet_addon.runtime.errors import SettingError, WeightsFileError

if TYPE_CHECKING:
    import torch
    from torch import nn

# Mean and standard deviation of the training pictures' red, green and blue, for values in [-1, 1].
_SHIFT = (-0.030, -0.088, -0.188)
_SCALE = (0.458, 0.448, 0.450)
_LEAST_NORM = 1e-10
LEAST_SIDE_PX = 31  # smaller pictures are empty after the second max pooling


@dataclass(frozen=True, eq=False)
class LpipsWeights:
    """Weights of LPIPS, float32. trunk: up to the fifth convolution. heads: five (1, channels, 1, 1)."""

    trunk: nn.Sequential
    heads: tuple[torch.Tensor, ...]

    @classmethod
    def load(cls, trunk_path: Path, heads_path: Path) -> Self:
        """Load torchvision's state dict of AlexNet, and the package lpips' v0.1 linear heads.

        Raises WeightsFileError for a missing or different file.
        """
        from torch import nn

        # As torchvision numbers them.
        trunk = nn.Sequential(
            nn.Conv2d(3, 64, 11, 4, 2), nn.ReLU(), nn.MaxPool2d(3, 2),
            nn.Conv2d(64, 192, 5, 1, 2), nn.ReLU(), nn.MaxPool2d(3, 2),
            nn.Conv2d(192, 384, 3, 1, 1), nn.ReLU(),
            nn.Conv2d(384, 256, 3, 1, 1), nn.ReLU(),
            nn.Conv2d(256, 256, 3, 1, 1), nn.ReLU(),
        )  # fmt: skip
        shapes = {name: value.shape for name, value in trunk.state_dict().items()}
        values = _read(trunk_path, {f"features.{name}": shape for name, shape in shapes.items()})
        trunk.load_state_dict(dict(zip(shapes, values, strict=True)))
        channels = [shape[0] for name, shape in shapes.items() if name.endswith("bias")]
        wanted = {f"lin{layer}.model.1.weight": (1, count, 1, 1) for layer, count in enumerate(channels)}
        return cls(trunk, tuple(_read(heads_path, wanted)))


def lpips(weights: LpipsWeights, pictures: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """LPIPS (N,) float64 of gray pictures (N, H, W) in [0, 1] against one reference (H, W).

    All are of one size. Raises SettingError for less than 31 pixels.
    """
    import torch

    if min(reference.shape) < LEAST_SIDE_PX:
        raise SettingError(f"LPIPS needs {LEAST_SIDE_PX} pixels a side, and the picture has {reference.shape}")
    total = np.zeros(len(pictures))
    with torch.no_grad():
        layers = _features(weights, pictures), _features(weights, reference[None])
        for head, found, wanted in zip(weights.heads, *layers, strict=True):
            total += (head * (found - wanted) ** 2).sum(dim=1).mean(dim=(1, 2)).numpy()
    return total


def _features(weights: LpipsWeights, gray: np.ndarray) -> list[torch.Tensor]:
    """Features (N, C, h, w) of the five convolutions, each pixel's of length 1, of gray pictures (N, H, W)."""
    import torch

    shift, scale = (torch.tensor(values)[:, None, None] for values in (_SHIFT, _SCALE))
    values = (2 * torch.as_tensor(gray, dtype=torch.float32)[:, None] - 1 - shift) / scale  # (N, 3, H, W)
    features = []
    for layer in weights.trunk:
        values = layer(values)
        if isinstance(layer, torch.nn.ReLU):
            features.append(values / (values.norm(dim=1, keepdim=True) + _LEAST_NORM))
    return features


def _read(path: Path, shapes: Mapping[str, tuple[int, ...]]) -> list[torch.Tensor]:
    """Tensors of a state dict by name, without executing the file's contents.

    Raises WeightsFileError if one is missing, has another shape, or is not finite.
    """
    from pickle import UnpicklingError

    import torch

    try:
        found = torch.load(path, map_location="cpu", weights_only=True)
    except (UnpicklingError, RuntimeError, EOFError, ValueError, KeyError, OSError) as cause:
        raise WeightsFileError(f"{path} cannot be read as a state dict of torch: fetch the file again") from cause
    values = []
    for name, shape in shapes.items():
        value: Any = found.get(name) if isinstance(found, dict) else None
        if getattr(value, "shape", None) != shape or not value.isfinite().all():
            raise WeightsFileError(
                f"{path} has no finite {name!r} of shape {shape}: give AlexNet's weights, then LPIPS v0.1's heads"
            )
        values.append(value.float())
    return values
