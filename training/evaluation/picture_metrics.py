# SPDX-License-Identifier: GPL-3.0-or-later
"""Picture metrics at budgets: SSIM, MS-SSIM, FLIP and LPIPS of what a refinement shows (methods 5, 7.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...patchnet_addon.image.comparison import clamped, flip
from ...patchnet_addon.image.tone import srgb_encode
from ...patchnet_addon.runtime.errors import SettingError
from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ...patchnet_addon.sampling.refine import refined_count, refined_picture
from .lpips import lpips
from .structure import structure_of

if TYPE_CHECKING:
    from .lpips import LpipsWeights

LINEAR, SRGB = "linear", "srgb"
NO_FLIP = "the package flip-evaluator is not there: install patchnet-blender[verify]"
FLIP_OF_LINEAR = "FLIP is of what a screen shows, and decodes it itself: see that of the sRGB picture"
FLIP_NOT_ASKED = "FLIP was not asked for"
NO_LPIPS = "no weights were given: load AlexNet's and the LPIPS v0.1 heads (LpipsWeights.load)"


@dataclass(frozen=True)
class PictureMetrics:
    """Metrics of one composed picture against the reference.

    ssim: over the full frame. ssim_active: mean of its map over active pixels; None without any. ms_ssim: over
    `ms_ssim_scales` scales. flip, lpips: None where they were not run, and `not_run` says why by
    name.
    """

    ssim: float
    ssim_active: float | None
    ms_ssim: float
    ms_ssim_scales: int
    flip: float | None
    lpips: float | None
    not_run: dict[str, str]


def composed_pictures(buffers: PixelBuffers, order: np.ndarray, budgets: Sequence[float]) -> np.ndarray:
    """(B, H, W) float32: linear luminance of the reference where each budget refines, of the preview elsewhere.

    order: (A,) active pixels, first refined first. Raises SettingError for a view without a reference, or a budget
    outside 0 to 1.
    """
    if buffers.reference is None:
        raise SettingError("The view has no reference: render it before pictures are compared")
    pictures = []
    for budget in budgets:
        mask = np.zeros(len(buffers.preview), bool)
        mask[order[: refined_count(buffers, budget, len(order))]] = True
        pictures.append(buffers.picture(refined_picture(buffers, mask)))
    return np.array(pictures, np.float32).reshape(len(budgets), buffers.height, buffers.width)


def picture_metrics(
    buffers: PixelBuffers, pictures: np.ndarray, weights: LpipsWeights | None = None, *, flips: bool = True
) -> dict[str, tuple[PictureMetrics, ...]]:
    """Measure composed pictures (N, H, W), of linear luminance (LINEAR) and of it sRGB-encoded (SRGB).

    flips: whether FLIP is run, which takes longer than all others together.
    Raises SettingError for a view without a reference, and for pictures smaller than the metrics' windows.
    """
    if buffers.reference is None:
        raise SettingError("The view has no reference: render it before pictures are compared")
    pictures = clamped(pictures)
    reference = clamped(buffers.picture(buffers.reference))
    active = buffers.picture(buffers.active)
    differences = [flip(picture, reference) if flips else None for picture in pictures]
    missing = {} if None not in differences else {"flip": NO_FLIP if flips else FLIP_NOT_ASKED}
    return {
        LINEAR: _measured(pictures, reference, active, [None] * len(pictures), {"flip": FLIP_OF_LINEAR}, weights),
        SRGB: _measured(srgb_encode(pictures), srgb_encode(reference), active, differences, missing, weights),
    }


def _measured(
    pictures: np.ndarray,
    reference: np.ndarray,
    active: np.ndarray,
    flips: Sequence[float | None],
    not_run: dict[str, str],
    weights: LpipsWeights | None,
) -> tuple[PictureMetrics, ...]:
    """Metrics of pictures (N, H, W) against the reference (H, W), both encoded alike."""
    perceived: list[float | None] = [None] * len(pictures)
    if weights is None:
        not_run = not_run | {"lpips": NO_LPIPS}
    else:
        perceived = lpips(weights, pictures, reference).tolist()
    found = structure_of(pictures, reference)
    in_active = found.similarity[:, active].mean(axis=1).tolist() if active.any() else [None] * len(pictures)
    columns = zip(found.ssim.tolist(), in_active, found.ms_ssim.tolist(), flips, perceived, strict=True)
    return tuple(
        PictureMetrics(ssim, ssim_active, ms_ssim, found.scales, flipped, distance, dict(not_run))
        for ssim, ssim_active, ms_ssim, flipped, distance in columns
    )
