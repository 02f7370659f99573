# SPDX-License-Identifier: GPL-3.0-or-later
"""Crops of rendered frames in batches, the same for the same seed and step."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from ....patchnet_addon.sampling.pixel_buffers import active_pixels
from .gbuffer import MASK
from .map_network import MapBatch, MapNetwork
from .rendered_frame import SUBPIXELS, RenderedFrame


def batch_of_crops(
    frames: Sequence[RenderedFrame], network: MapNetwork, *, batch: int, crop: int, seed: int, step: int
) -> MapBatch:
    """Draw `batch` crops of at most crop x crop pixels around active pixels of frames that are drawn evenly.

    Frames are of one size. Pixels that nothing is near of are not worth learning from: they are never refined.
    """
    rng = np.random.default_rng([seed, step])
    planes, pictures, fine = [], [], []
    for number in rng.integers(len(frames), size=batch):
        frame = frames[number]
        rows, columns = _corner(frame.planes[MASK] > 0, crop, rng)
        planes.append(network.planes(frame.planes[:, rows, columns]))
        pictures.append(frame.pictures[:, rows, columns])
        fine.append(frame.fine[_parts(rows), _parts(columns)])
    return MapBatch(*(torch.from_numpy(np.stack(values)) for values in (planes, pictures, fine)))


def _corner(hit: np.ndarray, crop: int, rng: np.random.Generator) -> tuple[slice, slice]:
    """Rows and columns of a crop in the middle of which an active pixel is, as far as the borders let it."""
    active = np.flatnonzero(active_pixels(hit))
    middle = rng.choice(active) if len(active) else rng.integers(hit.size)
    found = []
    for at, size in zip(divmod(int(middle), hit.shape[1]), hit.shape, strict=True):
        first = min(max(at - crop // 2, 0), max(size - crop, 0))
        found.append(slice(first, min(first + crop, size)))
    return found[0], found[1]


def _parts(pixels: slice) -> slice:
    return slice(SUBPIXELS * pixels.start, SUBPIXELS * pixels.stop)
