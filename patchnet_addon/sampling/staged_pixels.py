# SPDX-License-Identifier: GPL-3.0-or-later
"""View with further inputs for some of its pixels, and the estimator's scores of these."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..octree.octree import Octree
from ..runtime.bounds import DEFAULT_LOOKAHEAD
from ..tracing.camera import Camera
from .pixel_buffers import PixelBuffers
from .plus.forms import Form
from .strategy import BEHIND, CHILD_MASK, FINE_RAYS, NORMAL, PREDICTION
from .trace import seen_children, seen_normal

if TYPE_CHECKING:
    from ..codes.coded_octree import CodedOctree
    from ..tracing.render import Hits
    from .plus.weights import Estimators

# Results of each look, as parts of `PixelBuffers`.
_FOUND = {
    NORMAL: (NORMAL,),
    CHILD_MASK: (CHILD_MASK,),
    BEHIND: (BEHIND, "behind_hit"),
    FINE_RAYS: (FINE_RAYS,),
    PREDICTION: (PREDICTION,),
}
_MOST = 10  # up to 1/10 of the pixels are scored individually, more with the whole picture


@dataclass(frozen=True, eq=False)
class Looks:
    """Closer looks at chosen pixels (N,) of a view by index, traced and decoded for these only.

    coded: codes of the octree; None if no prediction is needed.
    """

    octree: Octree
    camera: Camera
    coded: CodedOctree | None

    def look(self, part: str, hits: Hits, pixels: np.ndarray) -> Sequence[Any]:
        """Compute a part of `PixelBuffers`, with those of the same look (`_FOUND`)."""
        from ..codes.predict import predict  # compiled code, which registration must not load
        from ..tracing.chosen import behind_of, fine_rays
        from ..tracing.render import seen_luminance

        if part == NORMAL:
            return (seen_normal(self.octree, hits.node[pixels]),)
        if part == CHILD_MASK:
            return (seen_children(self.octree, hits.node[pixels]),)
        if part == PREDICTION:
            assert self.coded is not None  # plans of stages require codes
            return (predict(self.coded, hits.part(pixels)),)
        lookahead = DEFAULT_LOOKAHEAD if self.coded is None else self.coded.weights.lookahead
        if part == FINE_RAYS:
            return (fine_rays(self.octree, self.camera, pixels, lookahead=lookahead),)
        nodes = behind_of(self.octree, self.camera, pixels, lookahead=lookahead)
        return seen_luminance(self.octree, nodes, hits.direction[pixels]), nodes >= 0


class KnownPixels:
    """View with further inputs for some pixels and defaults for all others.

    Defaults: a whole patch as bright as its voxel, nothing behind it, and finer rays equal to the one in the pixel's
    centre. The estimator reads them in the windows of scored pixels; most relevant neighbours have real values.
    """

    def __init__(self, buffers: PixelBuffers, looks: Looks | None) -> None:
        """Start from a view with hits and the finer ray in each pixel's centre.

        Other buffers of the view are read instead of a look. looks: None if the view has everything.
        """
        self._buffers, self._looks = buffers, looks
        self._view = PixelBuffers(
            buffers.hits,
            fine=buffers.fine,
            cube_side_world=buffers.cube_side_world,
            scene_luminance=buffers.scene_luminance,
        )
        self._looked: dict[str, np.ndarray] = {}

    def estimate(self, form: Form, pixels: np.ndarray, estimators: Estimators) -> np.ndarray:
        """Expected errors (N,) float32 of the preview in pixels (N,), after looking up the inputs of `form` there."""
        from .plus.compiled import estimate, estimate_chosen  # compiled code, as above
        from .plus_planes import chosen_windows, view_planes, window_pixels

        few = _MOST * len(pixels) < len(self._view.preview)
        around = window_pixels(pixels, self._view.width, self._view.height) if few or form.surface else pixels[:0]
        self._look_at(form, pixels, around)
        view = self._view
        if few:
            return estimate_chosen(chosen_windows(view, form, around), estimators, form)
        there = np.zeros((view.height, view.width), bool)
        there.flat[pixels] = True

        def planes_of(first: int, last: int) -> np.ndarray:
            return view_planes(view, form.planes, first, last)

        return estimate(planes_of, there, estimators, form).ravel()[pixels]

    def _look_at(self, form: Form, pixels: np.ndarray, around: np.ndarray) -> None:
        """Look at pixels (N,), and at the normals in their windows (9, N)."""
        if form.surface:
            there = np.zeros(len(self._view.preview), bool)
            there[around.ravel()] = True
            self._look_for(NORMAL, np.flatnonzero(there))
            self._look_for(CHILD_MASK, pixels)
        if form.behind:
            self._look_for(BEHIND, pixels)
        if form.rays == 4:
            self._look_for(FINE_RAYS, pixels)
        if form.network:
            self._look_for(PREDICTION, pixels)
            self._view = replace(self._view)  # a new object has no cached prediction

    def _look_for(self, part: str, pixels: np.ndarray) -> None:
        """Write a part, and those of the same look, into the view at those of pixels (N,) that have only defaults."""
        if part not in self._looked:
            self._looked[part] = np.zeros(len(self._view.preview), bool)
            self._view = replace(self._view, **self._stand_ins(part))
        new = pixels[~self._looked[part][pixels]]
        if not len(new):
            return
        self._looked[part][new] = True
        known = [getattr(self._buffers, name) for name in _FOUND[part]]
        if known[0] is not None:
            found: Sequence[Any] = [values[new] for values in known]
        else:
            assert self._looks is not None
            found = self._looks.look(part, self._view.hits, new)
        for name, values in zip(_FOUND[part], found, strict=True):
            getattr(self._view, name)[new] = values

    def _stand_ins(self, part: str) -> dict[str, Any]:
        """Defaults of all pixels for a part, and for those of the same look."""
        from ..codes.predict import Prediction  # compiled code, as above

        view, count = self._view, len(self._view.preview)
        if part == NORMAL:
            return {NORMAL: np.zeros((count, 3), np.float32)}
        if part == CHILD_MASK:
            return {CHILD_MASK: np.zeros(count, np.uint8)}
        if part == BEHIND:
            return {BEHIND: np.zeros(count, np.float32), "behind_hit": np.zeros(count, bool)}
        if part == FINE_RAYS:
            assert view.fine is not None
            return {FINE_RAYS: np.repeat(view.fine, 4).reshape(-1, 4)}
        return {PREDICTION: Prediction(np.ones(count, np.float32), view.preview.copy(), np.zeros(count, bool))}
