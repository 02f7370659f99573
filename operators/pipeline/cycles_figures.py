# SPDX-License-Identifier: GPL-3.0-or-later
"""Figures of a refinement by Cycles, its cost and its errors, as plain JSON values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ...patchnet_addon.sampling.predicted import PREDICTED, PREVIEW
from ...patchnet_addon.surface.textures import luminance
from ..settings.cycles_settings import REFERENCE_FACTOR, CyclesSettings

REFINED, COMPOSITED, OVER_UNREFINED, FULL = "refined_octree", "composited", "composited_over_unrefined", "full"


@dataclass(eq=False)
class Renders:
    """Cycles pictures, (H, W, 4) float32, linear unexposed light and alpha, and their wall seconds.

    pixels: the chosen pixels, empty elsewhere. seconds: of these, with reading the scene; sync_seconds: of reading
    alone. full: the whole picture with the same samples and seed, in full_seconds, with reading the scene. reference:
    with more samples and another seed.
    """

    pixels: np.ndarray
    seconds: float = 0.0
    sync_seconds: float = 0.0
    full: np.ndarray | None = None
    full_seconds: float = 0.0
    reference: np.ndarray | None = None


def shown_light(light: np.ndarray, exposure: float, colored: bool) -> np.ndarray:
    """Linear light (H, W, 3), or with alpha (H, W, 4), as the octree shows it: exposed, in [0, 1], (H, W) unless
    `colored`."""
    light = light[..., :3]
    return np.clip(np.float32(exposure) * (light if colored else luminance(light)), 0.0, 1.0).astype(np.float32)


def cycles_report(priority: np.ndarray, mask: np.ndarray, renders: Renders, settings: CyclesSettings) -> dict[str, Any]:
    """Shares and seconds."""
    total, held = (float(priority[where].sum(dtype=np.float64)) for where in (..., mask))
    report: dict[str, Any] = {
        "budget": settings.budget,
        "samples": settings.samples,
        "light": settings.light,
        "pixels_share": float(mask.mean()),
        "priority_share": held / total if total > 0 else 0.0,
        "seconds": {"pixels": renders.seconds, "of_that_reading_the_scene": renders.sync_seconds},
    }
    if renders.full is not None:
        report["seconds"]["full"] = renders.full_seconds
        report["reference_samples"] = REFERENCE_FACTOR * settings.samples
    return report


def squared_errors(
    buffers: PixelBuffers, mask: np.ndarray, renders: Renders, exposure: float, octree: tuple[np.ndarray, np.ndarray]
) -> dict[str, np.ndarray]:
    """Squared luminance errors (H, W) float64 against the reference, by name of the picture.

    octree: (P,) luminance of the view's refined picture, and of the octree's own rays below the pixels of Cycles. All
    errors include the noise of the reference.
    """
    assert renders.reference is not None and renders.full is not None
    reference, cycles, full = (
        shown_light(light, exposure, False) for light in (renders.reference, renders.pixels, renders.full)
    )
    refined, own = (buffers.picture(luminance) for luminance in octree)
    shown = buffers.picture(buffers.shown)
    pictures = {
        PREVIEW: buffers.picture(buffers.preview),
        OVER_UNREFINED: np.where(mask, cycles, shown),
        REFINED: refined,
        COMPOSITED: np.where(mask, cycles, own),
        FULL: full,
    }
    if buffers.shows_predicted:
        pictures[PREDICTED] = shown
    return {name: (picture.astype(np.float64) - reference) ** 2 for name, picture in pictures.items()}
