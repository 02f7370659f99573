# SPDX-License-Identifier: GPL-3.0-or-later
"""Render passes by name, and their pixels.

| pass | channels | what it is |
|---|---|---|
| Combined | RGBA | scene-linear light as in Cycles, premultiplied by alpha, over the world unless film is transparent |
| Depth | Z | distance along the camera's axis, as in Cycles; 1e10 where nothing was hit |
| Normal | XYZ | mean normal of the voxel in world space, towards the camera, unit length; 0 where there is none |
| Priority | X | order in which pixels are refined: the strategy's score times painted importance |
| Coverage | X | covered share of the pixel as predicted by the network; 1 without look-ahead, 0 beside objects |
| Sample Count | X | rays traced for the pixel's colour: 1, or 1024 where refined; 1 to 1024 with samples per pixel |
| Level | X | octree level of the pixel's voxel; -1 where nothing was hit |
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from ...patchnet_addon.octree.octree import Octree
    from ...patchnet_addon.sampling.adaptive import AdaptivePicture
    from ...patchnet_addon.tracing.hits import Hits

NO_DEPTH = 1e10  # what Cycles writes
BY_PRIORITY = ("Priority", "Coverage")  # only if pixels are refined by priority


class Pass(NamedTuple):
    """Pass as registered in Blender: its name, a letter per channel, and the type of its socket."""

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


def combined(picture: AdaptivePicture, world: np.ndarray | None) -> np.ndarray:
    """(P, 4) float32, premultiplied by alpha: light of the octree without its exposure, over `world`.

    world: (3,), or (P, 3), one for each pixel; None leaves the film transparent.
    """
    pixels = np.empty((len(picture.alpha), 4), np.float32)
    pixels[:, 3] = picture.alpha if world is None else 1.0
    open_share = 1.0 - picture.alpha
    for channel in range(3):  # a fifth of the time of all channels at once; viewports call it in each redraw
        light = picture.colors[:, channel] / np.float32(picture.octree.exposure)
        if world is not None:
            light += open_share * world[..., channel]
        pixels[:, channel] = light
    return pixels


def pass_pixels(picture: AdaptivePicture, world: np.ndarray | None) -> dict[str, np.ndarray]:
    """Pixels (P, C) float32 of each pass that is available: only Combined while pixels are being traced.

    BY_PRIORITY only if pixels are ranked.
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
        predicted = picture.buffers.prediction
        coverage = hits.hit if predicted is None else np.where(hits.hit, predicted.coverage, np.float32(0.0))
        values |= {"Priority": picture.ranking.priority, "Coverage": coverage}
    return known | {name: value.astype(np.float32).reshape(len(hits.hit), -1) for name, value in values.items()}


def _normals(octree: Octree, hits: Hits) -> np.ndarray:
    """(P, 3) normals turned towards the camera as in Cycles, since sheets are seen from both sides."""
    normals = np.zeros((len(hits.hit), 3), np.float32)
    mean = octree.normal_float(hits.node[hits.hit])
    away = np.einsum("pc,pc->p", mean, hits.direction[hits.hit]) > 0.0
    mean[away] *= -1.0
    normals[hits.hit] = mean / np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-12)
    return normals
