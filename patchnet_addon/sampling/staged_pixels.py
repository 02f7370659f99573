# SPDX-License-Identifier: GPL-3.0-or-later
"""Known parts of a view of which some pixels were looked at more closely, and the estimator's scores of these."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from .pixel_buffers import PixelBuffers
from .plus.forms import Form
from .staged_looks import Looks

if TYPE_CHECKING:
    from .plus.weights import Estimators

_MOST = 10  # times fewer pixels than the picture has are scored by themselves, more with the whole picture


class KnownPixels:
    """View of which some pixels are known better than others.

    Where nobody has looked, stand-ins say what is likeliest there: a patch that is whole and as bright as its voxel,
    nothing behind it, and finer rays that meet what the one in the pixel's centre met. The estimator reads them around
    pixels that it scores, of which nearly all that matter have been looked at themselves.
    """

    def __init__(self, buffers: PixelBuffers, looks: Looks, rays: int) -> None:
        """Begin with a view that has hits and the first finer rays, 1 or 4."""
        from ..codes.predict import Prediction  # compiled code, which registration must not load

        count = len(buffers.preview)
        self._looks = looks
        self._predicted, self._behind, self._normals = (np.zeros(count, bool) for _ in range(3))
        self._rays = np.full(count, rays == 4)
        self._view = replace(
            buffers,
            behind=np.zeros(count, np.float32),
            behind_hit=np.zeros(count, bool),
            fine_rays=buffers.fine_rays if rays == 4 else _like_the_center(buffers),
            prediction=Prediction(np.ones(count, np.float32), buffers.preview.copy(), np.zeros(count, bool)),
            normal=np.zeros((count, 3), np.float32),
            child_mask=np.zeros(count, np.uint8),
        )

    def estimate(self, form: Form, pixels: np.ndarray, estimators: Estimators) -> np.ndarray:
        """Expected errors (N,) float32 of the preview in pixels (N,), after a look at what `form` reads there."""
        from .plus.compiled import estimate, estimate_chosen  # compiled code, as above
        from .plus_planes import chosen_windows, view_planes, window_pixels

        around = window_pixels(pixels, self._view.width, self._view.height)
        view = self._view = self._looked_at(form, pixels, around)
        if _MOST * len(pixels) < len(view.preview):
            return estimate_chosen(chosen_windows(view, form.planes, around), estimators, form)
        there = np.zeros((view.height, view.width), bool)
        there.flat[pixels] = True

        def planes_of(first: int, last: int) -> np.ndarray:
            return view_planes(view, form.planes, first, last)

        return estimate(planes_of, there, estimators, form).ravel()[pixels]

    def _looked_at(self, form: Form, pixels: np.ndarray, around: np.ndarray) -> PixelBuffers:
        """View after a look at pixels (N,), and at normals of those in their windows (9, N)."""
        view, looks, hits = self._view, self._looks, self._view.hits
        assert view.behind is not None and view.behind_hit is not None and view.fine_rays is not None
        assert view.normal is not None and view.child_mask is not None and view.prediction is not None
        rays = view.fine_rays
        if form.surface:
            there = np.zeros(len(self._normals), bool)
            there[around.ravel()] = True
            new = np.flatnonzero(there & ~self._normals)
            view.normal[new], self._normals[new] = looks.normals(hits, new), True
            view.child_mask[pixels] = looks.child_masks(hits, pixels)
        if form.behind and len(new := pixels[~self._behind[pixels]]):
            view.behind[new], view.behind_hit[new] = looks.behind(new)
            self._behind[new] = True
        if form.rays == 4 and len(new := pixels[~self._rays[pixels]]):
            rays = rays if rays.flags.writeable else rays.copy()
            rays[new], self._rays[new] = looks.fine_rays(new), True
        if form.network and len(new := pixels[~self._predicted[pixels]]):
            found = looks.prediction(hits, new)
            view.prediction.coverage[new], view.prediction.luminance[new] = found.coverage, found.luminance
            view.prediction.look_ahead[new], self._predicted[new] = found.look_ahead, True
        return replace(view, fine_rays=rays)  # a new one, which has computed nothing of the old values yet


def _like_the_center(buffers: PixelBuffers) -> np.ndarray:
    """Four finer rays (P, 4) that meet what the one in the pixel's center has met."""
    assert buffers.fine is not None
    return np.broadcast_to(buffers.fine[:, None], (len(buffers.fine), 4))
