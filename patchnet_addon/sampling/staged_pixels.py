# SPDX-License-Identifier: GPL-3.0-or-later
"""Known parts of a view of which some pixels were looked at more closely, and the estimator's scores of these."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from .pixel_buffers import PixelBuffers
from .plus.forms import Form
from .staged_looks import Looks

if TYPE_CHECKING:
    from .plus.weights import Estimators

_LOOKS = _NORMALS, _BEHIND, _RAYS, _PREDICTION = "normals", "behind", "fine rays", "prediction"
_MOST = 10  # times fewer pixels than the picture has are scored by themselves, more with the whole picture


class KnownPixels:
    """View of which some pixels are known better than others.

    Where nobody has looked, stand-ins say what is likeliest there: a patch that is whole and as bright as its voxel,
    nothing behind it, and finer rays that meet what the one in the pixel's centre met. The estimator reads them around
    pixels that it scores, of which nearly all that matter have been looked at themselves.
    """

    def __init__(self, buffers: PixelBuffers, looks: Looks) -> None:
        """Begin with a view that has hits and the finer ray in each pixel's center."""
        self._looks = looks
        self._view = PixelBuffers(
            buffers.hits,
            fine=buffers.fine,
            cube_side_world=buffers.cube_side_world,
            scene_luminance=buffers.scene_luminance,
        )
        self._looked = {look: np.zeros(len(buffers.preview), bool) for look in _LOOKS}

    def estimate(self, form: Form, pixels: np.ndarray, estimators: Estimators) -> np.ndarray:
        """Expected errors (N,) float32 of the preview in pixels (N,), after a look at what `form` reads there."""
        from .plus.compiled import estimate, estimate_chosen  # compiled code, as above
        from .plus_planes import chosen_windows, view_planes, window_pixels

        few = _MOST * len(pixels) < len(self._view.preview)
        around = window_pixels(pixels, self._view.width, self._view.height) if few or form.surface else pixels[:0]
        view = self._view = self._looked_at(form, pixels, around)
        if few:
            return estimate_chosen(chosen_windows(view, form, around), estimators, form)
        there = np.zeros((view.height, view.width), bool)
        there.flat[pixels] = True

        def planes_of(first: int, last: int) -> np.ndarray:
            return view_planes(view, form.planes, first, last)

        return estimate(planes_of, there, estimators, form).ravel()[pixels]

    def _looked_at(self, form: Form, pixels: np.ndarray, around: np.ndarray) -> PixelBuffers:
        """View after a look at pixels (N,), and at normals of those in their windows (9, N)."""
        view, looks, hits = self._with_stand_ins(form), self._looks, self._view.hits
        if form.surface:
            assert view.normal is not None and view.child_mask is not None
            there = np.zeros(len(view.normal), bool)
            there[around.ravel()] = True
            new = self._new(_NORMALS, np.flatnonzero(there))
            view.normal[new] = looks.normals(hits, new)
            view.child_mask[pixels] = looks.child_masks(hits, pixels)
        if form.behind and len(new := self._new(_BEHIND, pixels)):
            assert view.behind is not None and view.behind_hit is not None
            view.behind[new], view.behind_hit[new] = looks.behind(new)
        if form.rays == 4 and len(new := self._new(_RAYS, pixels)):
            assert view.fine_rays is not None
            view.fine_rays[new] = looks.fine_rays(new)
        if form.network and len(new := self._new(_PREDICTION, pixels)):
            assert view.prediction is not None
            found = looks.prediction(hits, new)
            view.prediction.coverage[new], view.prediction.luminance[new] = found.coverage, found.luminance
            view.prediction.look_ahead[new] = found.look_ahead
        return replace(view) if form.network else view  # a new one has computed nothing of the old prediction yet

    def _new(self, look: str, pixels: np.ndarray) -> np.ndarray:
        """Pixels of (N,) without such a look, which have one now."""
        new = pixels[~self._looked[look][pixels]]
        self._looked[look][new] = True
        return new

    def _with_stand_ins(self, form: Form) -> PixelBuffers:
        """View with all parts that `form` reads."""
        from ..codes.predict import Prediction  # compiled code, which registration must not load

        view, count = self._view, len(self._view.preview)
        added: dict[str, Any] = {}
        if form.surface and view.normal is None:
            added = {"normal": np.zeros((count, 3), np.float32), "child_mask": np.zeros(count, np.uint8)}
        if form.behind and view.behind is None:
            added |= {"behind": np.zeros(count, np.float32), "behind_hit": np.zeros(count, bool)}
        if form.rays == 4 and view.fine_rays is None:
            assert view.fine is not None
            added["fine_rays"] = np.repeat(view.fine, 4).reshape(-1, 4)  # they meet what the one in the center has met
        if form.network and view.prediction is None:
            whole = np.ones(count, np.float32), view.preview.copy(), np.zeros(count, bool)
            added["prediction"] = Prediction(*whole)
        return replace(view, **added) if added else view
