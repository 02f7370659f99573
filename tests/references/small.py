# SPDX-License-Identifier: GPL-3.0-or-later
"""Plain references of small kernels: leaf boxes, error estimates, windows, chroma, ray frames."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from patchnet.patchnet_addon.cells.leaf_box_kernels import _MARGIN
from patchnet.patchnet_addon.cells.leaf_boxes import STEPS
from patchnet.patchnet_addon.sampling.plus.features import HIGHEST, LOWEST, features_of, windows_of
from patchnet.patchnet_addon.sampling.plus.forms import FORMS, Form
from patchnet.patchnet_addon.sampling.plus.weights import Estimators, Network, layer_sizes
from patchnet.patchnet_addon.surface.chroma import GRAY_SHARE, SHARE_SCALE
from patchnet.tests.references.networks import run_layers


def boxes_reference(points: np.ndarray) -> np.ndarray:
    """Reference of `packed_axis`: the box (3,) uint8 around points (n, 3), in voxels from the leaf's lowest corner."""
    low = np.clip(np.floor(points.min(axis=0) * STEPS - _MARGIN), 0, STEPS - 1)
    high = np.clip(np.ceil(points.max(axis=0) * STEPS + _MARGIN) - 1, low, STEPS - 1)
    return (low + STEPS * high).astype(np.uint8)


def random_estimators(seed: int) -> Estimators:
    """Estimators of all forms with random weights."""
    random = np.random.default_rng(seed)

    def normal(*shape: int, deviation: float) -> np.ndarray:
        return (random.standard_normal(shape) * deviation).astype(np.float32)

    networks = {}
    for name, form in FORMS.items():
        sizes = pairwise(layer_sizes(form))
        layers = tuple((normal(after, n, deviation=n**-0.5), normal(after, deviation=0.1)) for n, after in sizes)
        networks[name] = Network(layers, normal(len(form.features), deviation=0.1))
    return Estimators(networks)


def estimate_reference(planes: np.ndarray, estimators: Estimators, form: Form) -> np.ndarray:
    """Expected error sqrt(E[e^2]) of every pixel, (H * W,) float32; reference of `estimate`, which skips some pixels.

    planes: (C, H + 2, W + 2), the form's planes with a border.
    """
    values, scale = features_of(windows_of(planes), form)
    layers, skip = estimators.networks[form.name]
    (variance, mean), direct = run_layers(layers, values.T).T, skip @ values
    result: np.ndarray = np.sqrt(scale * ((mean + direct) ** 2 + np.exp(np.clip(variance, LOWEST, HIGHEST))))
    return result


def window_variance_reference(picture: np.ndarray) -> np.ndarray:
    """Reference of `window_variance` in NumPy."""
    padded = np.pad(picture.astype(np.float64), 1, constant_values=np.nan)
    result: np.ndarray = np.nanvar(sliding_window_view(padded, (3, 3)), axis=(2, 3))
    return result


def encoded_chroma_reference(colors: np.ndarray) -> np.ndarray:
    """Chroma (n, 2) uint8 of linear colours (n, 3) of any brightness; gray for black."""
    values = np.maximum(np.asarray(colors, np.float64), 0.0)
    total = values.sum(axis=-1, keepdims=True)
    lit = total > 0.0
    shares = np.rint(values[..., ::2] / np.where(lit, total, 1.0) * SHARE_SCALE)
    return np.where(lit, shares, GRAY_SHARE).astype(np.uint8)


def ray_up_reference(direction: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Reference of `ray_up` in NumPy."""
    up = np.asarray(up, np.float64)
    along = direction.astype(np.float64) @ up
    across = up - along[:, None] * direction
    return (across / np.linalg.norm(across, axis=1, keepdims=True)).astype(np.float32)
