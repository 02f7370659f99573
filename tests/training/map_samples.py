# SPDX-License-Identifier: GPL-3.0-or-later
"""Rendered frames of noise, for tests of the map networks."""

import numpy as np

from patchnet.training.evaluation.networks.frames import SUBPIXELS, RenderedFrame


def noise_frame(seed: int = 0, height: int = 35, width: int = 45) -> RenderedFrame:
    """A frame whose error follows from its planes, so that it can be learnt: luminance 0.2 is wrong where it is hit."""
    rng = np.random.default_rng(seed)
    planes = rng.random((9, height, width)).astype(np.float32)
    planes[1] = rng.random((height, width)) < 0.5
    planes[2:] *= planes[1]
    planes[0] = np.where(planes[1] > 0, 0.2, 0.6)
    reference = np.where(planes[1] > 0, 0.5, 0.6).astype(np.float32)
    pictures = np.stack([planes[0] + share * (reference - planes[0]) for share in (0.0, 0.5, 0.75, 0.9)])
    return RenderedFrame(planes, pictures.astype(np.float32), np.kron(reference, np.ones((SUBPIXELS,) * 2, np.float32)))
