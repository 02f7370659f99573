# SPDX-License-Identifier: GPL-3.0-or-later
"""LPIPS v0.1 with AlexNet, by weights that users supply, since PatchNet cannot distribute them (methods 5).

Zhang, Isola, Efros, Shechtman, Wang, "The Unreasonable Effectiveness of Deep Features as a Perceptual Metric", CVPR
2018; AlexNet is that of Krizhevsky, "One weird trick for parallelizing convolutional neural networks", 2014.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from ...patchnet_addon.runtime.errors import PatchNetError, SettingError, WeightsFileError

if TYPE_CHECKING:
    import torch

# Layers of the trunk: number in torchvision's file, channels in and out, side of the kernel, stride, padding, and
# whether a maximum over 3 x 3 pixels in steps of 2 comes before.
_LAYERS = (
    (0, 3, 64, 11, 4, 2, False),
    (3, 64, 192, 5, 1, 2, True),
    (6, 192, 384, 3, 1, 1, True),
    (8, 384, 256, 3, 1, 1, False),
    (10, 256, 256, 3, 1, 1, False),
)
# Mean and standard deviation of the training pictures' red, green and blue, for values in [-1, 1].
_SHIFT = (-0.030, -0.088, -0.188)
_SCALE = (0.458, 0.448, 0.450)
_LEAST_NORM = 1e-10
LEAST_SIDE_PX = 31  # smaller pictures are empty after the second max pooling
_CHUNK = 16  # pictures at once, for memory


@dataclass(frozen=True, eq=False)
class LpipsWeights:
    """Weights of LPIPS, float32.

    trunk: kernels (out, in, k, k) and biases (out,) of the five convolutions. heads: five (1, channels, 1, 1).
    """

    trunk: tuple[tuple[torch.Tensor, torch.Tensor], ...]
    heads: tuple[torch.Tensor, ...]

    @classmethod
    def load(cls, trunk_path: Path, heads_path: Path) -> Self:
        """Load torchvision's state dict of AlexNet, and the package lpips' v0.1 linear heads.

        Raises PatchNetError without torch, and WeightsFileError for a missing or different file.
        """
        trunk_file, heads_file = _read(trunk_path), _read(heads_path)
        trunk, heads = [], []
        for layer, (number, before, after, side, *_) in enumerate(_LAYERS):
            kernel = _entry(trunk_file, f"features.{number}.weight", (after, before, side, side), trunk_path)
            trunk.append((kernel, _entry(trunk_file, f"features.{number}.bias", (after,), trunk_path)))
            heads.append(_entry(heads_file, f"lin{layer}.model.1.weight", (1, after, 1, 1), heads_path))
        return cls(tuple(trunk), tuple(heads))


def lpips(weights: LpipsWeights, pictures: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """LPIPS (N,) float64 of gray pictures (N, H, W) in [0, 1] against one reference (H, W).

    All are of one size. Raises SettingError for less than 31 pixels.
    """
    import torch

    if min(reference.shape) < LEAST_SIDE_PX:
        raise SettingError(f"LPIPS needs {LEAST_SIDE_PX} pixels a side, and the picture has {reference.shape}")
    with torch.no_grad():
        wanted = _features(weights, torch.as_tensor(reference[None]).to(weights.heads[0]))
        parts = []
        for start in range(0, len(pictures), _CHUNK):
            chunk = torch.as_tensor(pictures[start : start + _CHUNK]).to(weights.heads[0])
            parts.append(_distances(weights, _features(weights, chunk), wanted).numpy())
    return np.concatenate([np.empty(0), *parts])


def _distances(weights: LpipsWeights, found: list[torch.Tensor], wanted: list[torch.Tensor]) -> torch.Tensor:
    """Sum over layers (N,) of the pictures' means of weighted squared differences."""
    import torch

    layers = zip(weights.heads, found, wanted, strict=True)
    parts = [(head * (mine - its) ** 2).sum(dim=1).mean(dim=(1, 2)) for head, mine, its in layers]
    return torch.stack(parts).sum(dim=0)


def _features(weights: LpipsWeights, gray: torch.Tensor) -> list[torch.Tensor]:
    """Features (N, C, h, w) of the five layers, each pixel's of length 1, of gray pictures (N, H, W) in [0, 1]."""
    import torch
    from torch.nn import functional

    shift, scale = (torch.tensor(values).to(gray)[:, None, None] for values in (_SHIFT, _SCALE))
    values = (2 * gray[:, None] - 1 - shift) / scale  # (N, 3, H, W)
    features = []
    for (*_, stride, padding, pooled), (kernel, bias) in zip(_LAYERS, weights.trunk, strict=True):
        if pooled:
            values = functional.max_pool2d(values, 3, 2)
        values = functional.relu(functional.conv2d(values, kernel, bias, stride, padding))
        features.append(values / (values.norm(dim=1, keepdim=True) + _LEAST_NORM))
    return features


def _read(path: Path) -> Any:
    """Read a state dict without executing its contents."""
    try:
        import torch
    except ImportError as cause:
        raise PatchNetError(f"LPIPS needs torch ({cause}): install patchnet-blender[train]") from cause
    from pickle import UnpicklingError

    try:
        return torch.load(path, map_location="cpu", weights_only=True)
    except (UnpicklingError, RuntimeError, EOFError, ValueError, KeyError, OSError) as cause:
        raise WeightsFileError(f"{path} cannot be read as a state dict of torch: fetch the file again") from cause


def _entry(found: Any, name: str, shape: tuple[int, ...], path: Path) -> torch.Tensor:
    """Tensor of a state dict; raises WeightsFileError if it is missing, has another shape, or is not finite."""
    value: Any = found.get(name) if isinstance(found, dict) else None
    if getattr(value, "shape", None) != shape or not value.isfinite().all():
        raise WeightsFileError(
            f"{path} has no finite {name!r} of shape {shape}: give AlexNet's weights, then LPIPS v0.1's heads"
        )
    return value.float()
