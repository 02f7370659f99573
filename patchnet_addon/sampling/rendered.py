# SPDX-License-Identifier: GPL-3.0-or-later
"""Final picture of a render: its pixels in memory that Blender's process sees while it is worked on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..octree.octree import Octree
from ..runtime.progress import Progress, Steps, changed
from ..tracing.camera import Camera
from ..tracing.empty_view import why_unseen
from .adaptive import Importance, PictureSettings
from .passes import traced_passes

if TYPE_CHECKING:
    from ..codes.coded_octree import CodedOctree

_TRACING = 0.3  # share of the time


class RenderedPixels(NamedTuple):
    """Pixels of a picture that is being worked on.

    values, samples: of the `AdaptivePicture`, which change. passes: see `traced_passes`; none before all pixels are
    traced. unseen: sentence about a picture that shows nothing, see `why_unseen`.
    """

    values: np.ndarray
    samples: np.ndarray
    passes: Mapping[str, np.ndarray]
    unseen: str | None = None


def rendered_picture(
    octree: Octree, coded: CodedOctree | None, camera: Camera, wanted: PictureSettings, importance: Importance | None
) -> Steps[None]:
    """Trace all rays of a picture; the first report, and the first after one ray in each pixel, bring RenderedPixels.

    Raises the errors of `AdaptivePicture`.
    """
    picture = wanted.picture(octree, camera, coded, importance)
    yield Progress(0, 1, "Tracing the preview", partial=RenderedPixels(picture.values, picture.samples, {}))
    yield from _share(picture.trace(), 0.0, _TRACING)
    assert picture.buffers is not None
    unseen = why_unseen(octree, camera, picture.buffers.hits, float(picture.buffers.preview.max()))
    pixels = RenderedPixels(picture.values, picture.samples, traced_passes(picture), unseen)
    yield Progress(1, 1, "Tracing the preview", whole=_TRACING, partial=pixels)
    yield from _share(wanted.more_rays(picture), _TRACING, 1.0)


def _share(steps: Steps[None], start: float, end: float) -> Steps[None]:
    """Steps that are a part of all."""
    return changed(steps, lambda report: replace(report, whole=start + (end - start) * report.fraction))
