# SPDX-License-Identifier: GPL-3.0-or-later
"""Render passes by name, and their pixels.

| pass | channels | what it is |
|---|---|---|
| Combined | RGBA | scene-linear light as Cycles' has it, weighed by alpha, over the world unless film is transparent |
| Depth | Z | distance along the camera's axis, as Cycles'; 1e10 where nothing was met |
| Normal | XYZ | mean normal of the voxel in world space, towards the camera, unit length; 0 where there is none |
| Priority | X | what pixels are refined by: the strategy's score, times painted importance |
| Coverage | X | share of the pixel that the network expects to be covered; 1 without look-ahead, 0 beside objects |
| Sample Count | X | rays traced for the pixel's colour: 1, or 1024 where refined; 1 to 1024 with samples per pixel |
| Level | X | level of the octree that the pixel's voxel is on; -1 where nothing was met |
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from ...patchnet_addon.octree.octree import Octree
    from ...patchnet_addon.sampling.adaptive import AdaptivePicture
    from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
    from ...patchnet_addon.tracing.render import Hits

NO_DEPTH = 1e10  # what Cycles writes


class Pass(NamedTuple):
    """Pass as Blender registers it: a name, a letter for each channel, and what the compositor takes it for."""

    name: str
    channels: str
    kind: str


PASSES = (
    Pass("Combined", "RGBA", "COLOR"),
    Pass("Depth", "Z", "VALUE"),
    Pass("Normal", "XYZ", "VECTOR"),
    Pass("Priority", "X", "VALUE"),
    Pass("Coverage", "X", "VALUE"),
    Pass("Sample Count", "X", "VALUE"),
    Pass("Level", "X", "VALUE"),
)
BY_PRIORITY = ("Priority", "Coverage")  # where pixels are refined by priority, not sampled alike


def combined(picture: AdaptivePicture, world: np.ndarray | None) -> np.ndarray:
    """(P, 4) float32, weighed by alpha: the light that the octree holds without its exposure, over `world`.

    world: (3,), or (P, 3) as each pixel sees it; None leaves the film transparent.
    """
    pixels = np.empty((len(picture.alpha), 4), np.float32)
    pixels[:, 3] = picture.alpha if world is None else 1.0
    open_share = 1.0 - picture.alpha
    for channel in range(3):  # a fifth of the time that NumPy takes for all at once, and viewports do it all the time
        light = picture.colors[:, channel] / np.float32(picture.octree.exposure)
        if world is not None:
            light += open_share * world[..., channel]
        pixels[:, channel] = light
    return pixels


def pass_pixels(picture: AdaptivePicture, world: np.ndarray | None) -> dict[str, np.ndarray]:
    """Pixels (P, C) float32 of each pass that is known by now: only Combined as long as pixels are being traced.

    Those of BY_PRIORITY only where pixels are ranked.
    """
    known = {"Combined": combined(picture, world)}
    if picture.buffers is None:
        return known
    hits = picture.buffers.hits
    values = {
        "Depth": np.where(hits.hit, hits.z_world, np.float32(NO_DEPTH)),
        "Normal": _normals(picture.octree, hits),
        "Sample Count": picture.samples,
        "Level": np.where(hits.hit, hits.level, -1),
    }
    if picture.ranking is not None:
        values |= {"Priority": picture.ranking.priority, "Coverage": _coverage(picture.buffers)}
    return known | {name: value.astype(np.float32).reshape(len(hits.hit), -1) for name, value in values.items()}


def _normals(octree: Octree, hits: Hits) -> np.ndarray:
    """(P, 3): a sheet is seen from both sides, so its normal is turned towards the camera, as Cycles does."""
    normals = np.zeros((len(hits.hit), 3), np.float32)
    mean = octree.normal_float(hits.node[hits.hit])
    away = np.einsum("pc,pc->p", mean, hits.direction[hits.hit]) > 0.0
    mean[away] *= -1.0
    normals[hits.hit] = mean / np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-12)
    return normals


def _coverage(buffers: PixelBuffers) -> np.ndarray:
    if buffers.prediction is None:
        return buffers.hit
    return np.where(buffers.hit, buffers.prediction.coverage, np.float32(0.0))
