# SPDX-License-Identifier: GPL-3.0-or-later
"""KKR18: sampling-map network of Kuznetsov, Kalantari and Ramamoorthi, retrained without a denoiser (methods 3.10).

"Deep Adaptive Sampling for Low Sample Count Rendering", 2018. As in the paper: the U-Net, its inputs and their
logarithms, the map as an exponential with four samples in the mean, the gradient of a picture by its samples, (I_inf -
I_s) / s, the two terms of the loss, Adam at 1e-4 in batches of 6. Different: the loss is that of the sampled picture
itself, since no denoiser follows; the stored pictures of the renderer simulator are complete regular grids of 1, 4, 16
and 64 rays in each pixel, between which it interpolates; color and albedo are gray luminance, shadow is 1; depth is in
hundredths of the octree's side instead of scene units; training uses crops.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from .frames import DISTANCE, LUMINANCE, NORMALS, SIDES
from .map_network import MapBatch, MapNetwork
from .unet import UNet

INPUTS = 11
_MEAN = 4.0  # samples a pixel
_FIXED_POINT_STEPS = 3
_COUNTS = tuple(side**2 for side in SIDES)
_DEPTH_UNITS = 100.0  # in a side of the octree
_EPSILON = 0.01
_KERNEL, _SIGMA = 11, 1.5


def kuznetsov_planes(planes: np.ndarray) -> np.ndarray:
    """Input (11, H, W) of a G-buffer: colour, depth, albedo, normal, shadow."""
    luminance = planes[LUMINANCE, None]
    color = np.repeat(np.log1p(luminance), 3, axis=0)
    depth = np.log1p(_DEPTH_UNITS * planes[DISTANCE, None]) / 2
    albedo = np.repeat(luminance, 3, axis=0)
    return np.concatenate([color, depth, albedo, planes[NORMALS], np.ones_like(luminance)])


def sampling_map(output: Tensor) -> Tensor:
    """Samples per pixel (B, H, W), continuous, of the network's output (B, H, W).

    The paper's exponential, scaled so that the mean of max(1, round(samples)) is 4 in each picture.
    """
    flat = output.flatten(1)
    samples = (_MEAN * flat.shape[1] * torch.softmax(flat, dim=1)).view_as(output)
    factor = torch.ones_like(samples[:, :1, :1])
    for _ in range(_FIXED_POINT_STEPS):
        counts = (factor * samples.detach()).round().clamp(min=1.0)
        factor = factor * _MEAN / counts.mean(dim=(1, 2), keepdim=True)
    return factor * samples


class SampledPicture(torch.autograd.Function):
    """Renderer simulator: a picture of as many samples in each pixel as a map says.

    apply(samples, pictures, reference): (B, h, w) of samples (B, h, w), at least 1, pictures (B, 4, h, w) of 1, 4, 16
    and 64 rays, and the reference (B, h, w). Between two counts the pictures are interpolated; above the last the
    error falls with the root of the count. The gradient by the samples is (I_inf - I_s) / s.
    """

    @staticmethod
    def forward(ctx: Any, samples: Tensor, pictures: Tensor, reference: Tensor) -> Tensor:
        """Compose the picture."""
        most = _COUNTS[-1]
        beyond = torch.sqrt(most / samples.clamp(min=most))
        picture = torch.lerp(reference, pictures[:, -1], beyond)
        for index in reversed(range(len(_COUNTS) - 1)):
            low, high = _COUNTS[index], _COUNTS[index + 1]
            between = torch.lerp(pictures[:, index], pictures[:, index + 1], (samples - low) / (high - low))
            picture = torch.where(samples < high, between, picture)
        ctx.save_for_backward(samples, picture, reference)
        return picture

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None, None]:
        """Gradient by the samples alone."""
        samples, picture, reference = ctx.saved_tensors
        return gradient * (reference - picture) / samples, None, None


def _edges(pictures: Tensor) -> Tensor:
    """Laplacian of Gaussian, after a Gaussian, of pictures (B, 1, h, w); borders are continued."""
    for kernel in _kernels():
        padded = functional.pad(pictures, [_KERNEL // 2] * 4, mode="replicate")
        pictures = functional.conv2d(padded, kernel.to(pictures))
    return pictures


def _kernels() -> tuple[Tensor, Tensor]:
    """Gaussian, of sum 1, and Laplacian of Gaussian, of sum 0, (1, 1, 11, 11)."""
    at = torch.arange(_KERNEL, dtype=torch.float64) - _KERNEL // 2
    square = (at[:, None] ** 2 + at**2) / (2 * _SIGMA**2)
    gauss = torch.exp(-square)
    laplace = -(1 - square) * gauss / (math.pi * _SIGMA**4)
    return (gauss / gauss.sum())[None, None], (laplace - laplace.mean())[None, None]


def _loss(network: nn.Module, batch: MapBatch) -> Tensor:
    """Mean relative difference of the sampled pictures, and of their edges, in logarithms."""
    samples = sampling_map(network(batch.planes)).clamp(min=1.0)
    picture: Tensor = SampledPicture.apply(samples, batch.pictures, batch.reference)
    found, wanted = torch.log1p(picture)[:, None], torch.log1p(batch.reference)[:, None]
    edges = _edges(found) - _edges(wanted)
    return ((found - wanted).abs() / (wanted + _EPSILON)).mean() + (edges.abs() / (wanted + _EPSILON)).mean()


KUZNETSOV = MapNetwork(
    name="kuznetsov",
    strategy="kkr18",
    title="Sampling map (KKR18, without denoiser)",
    description="Sampling map of a U-Net on luminance, depth and normal, trained by the sampled picture, no denoiser",
    quantity="samples per pixel",
    maximum=32.0,
    planes=kuznetsov_planes,
    build=lambda: UNet(INPUTS),
    scores=lambda network, planes: sampling_map(network(planes)),
    loss=_loss,
    batch=6,
    crop=96,
)
