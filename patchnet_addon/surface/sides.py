# SPDX-License-Identifier: GPL-3.0-or-later
"""Sides of a surface and faces of a voxel: what they are, which one a normal gives, and the mean of two sides.

A triangle, and so its sheet and surfels, has two sides, FRONT and BACK. A side is lit if it gets light of its own. A
voxel has six faces, +x, -x, +y, -y, +z and -z, numbered 0 to 5, so that `face ^ 1` is the opposite one. Light of a
surface belongs to the faces that its side points to; a ray sees the three faces that it runs against (methods 7.2i).
`side_kernels.py` has functions for kernels.
"""

from __future__ import annotations

import numpy as np

from .chroma import REC709

FRONT, BACK = 0, 1
SIGNS = 1.0, -1.0  # of the normal, by side
LIT_FRONT, LIT_BACK, LIT_BOTH = 1, -1, 0  # lit sides of a triangle; of the other side alone, the negative
FACES = 6
_LEAST_LIGHT = np.float32(1e-30)


def faces_of(normals: np.ndarray) -> np.ndarray:
    """Faces (T,) uint8 that directions (T, 3) point to most; of equal axes the first."""
    axis = np.abs(normals).argmax(axis=1)
    return (2 * axis + (normals[np.arange(len(axis)), axis] < 0.0)).astype(np.uint8)


def mean_of_sides(lights: np.ndarray, back: np.ndarray) -> np.ndarray:
    """Light (F, C) of both sides (F, 2, C), blended with the share (F,) of the back; C as in `Shading`."""
    hue = lights[..., 1:]
    weights = np.stack([np.float32(1.0) - back, back], axis=1)
    mean = np.einsum("fs,fs->f", weights, lights[..., 0])[:, None]
    if not hue.shape[-1]:
        return mean
    scale = lights[..., 0] / np.maximum(hue @ REC709, _LEAST_LIGHT)
    return np.concatenate([mean, np.einsum("fs,fsc->fc", weights * scale, hue)], axis=1)
