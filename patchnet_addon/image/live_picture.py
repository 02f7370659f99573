# SPDX-License-Identifier: GPL-3.0-or-later
"""Picture of a viewport while it is worked on, in memory that Blender's process sees.

Large squares come first, then one ray per pixel, then equally many in all or refinement by priority within a budget.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..octree.octree import Octree
from ..process.segments import shared_zeros
from ..runtime.progress import Progress, Steps
from ..sampling.adaptive import REFINED_SIDE, AdaptivePicture, Importance, Pace, PictureSettings
from ..sampling.passes import combined
from ..tracing.camera import Camera
from .cube_map import CubeMap, pixel_directions

if TYPE_CHECKING:
    from ..codes.coded_octree import CodedOctree

World = np.ndarray | CubeMap | None  # one colour (3,), light by direction, or transparent
COARSE = 4  # side of the first picture's squares, in pixels
_QUICK_SIDE = 4  # rays per pixel side of the first pass over the budget
_PACE = Pace(1 << 14, 1 << 17)  # a hundredth of a second each on two cores; larger steps save nothing
_SHOWN_S = 0.04  # least time between two pictures
_SHOWN_SHARE = 3.0  # and least multiple of the time that showing one takes
_CACHED = 1 << 16  # pixels


class LivePixels(NamedTuple):
    """Pixels of a picture that is being worked on, in memory that both processes see.

    shown: (H, W, 4) float32, what to draw, see `combined`; the first picture has a ray for each square of COARSE x
    COARSE pixels, and none of the following. values, samples: of the `AdaptivePicture`. background: (P, 3) float32,
    which is behind the next picture; None where it is transparent. traced: each pixel has a ray. importance: weights
    (P,) of the finished picture, None if all pixels matter alike.
    """

    shown: np.ndarray
    values: np.ndarray | None = None
    samples: np.ndarray | None = None
    background: np.ndarray | None = None
    traced: bool = False
    importance: np.ndarray | None = None


def live_picture(
    octree: Octree,
    coded: CodedOctree | None,
    camera: Camera,
    wanted: PictureSettings,
    importance: Importance | None,
    world: World,
) -> Steps[None]:
    """Work on a picture; reports bring LivePixels where what is shown has changed.

    Raises the errors of `AdaptivePicture`.
    """
    tracing = Progress(0, 1, "Tracing the preview")
    coarse = _coarse_picture(octree, camera, world)
    yield replace(tracing, partial=LivePixels(coarse))  # a view that moves shows no more: short steps follow
    shown = shared_zeros((camera.height_px, camera.width_px, 4), np.float32)
    yield tracing
    _enlarge(coarse, shown)
    yield tracing
    picture = wanted.picture(octree, camera, coded, importance)
    yield tracing
    background = None
    if world is not None:
        background = shared_zeros((camera.pixel_count, 3), np.float32)
        yield tracing
        yield from fill_background(background, camera, world)
    pixels = LivePixels(shown, picture.values, picture.samples, background)
    yield replace(tracing, partial=pixels)
    due = time.monotonic() + _SHOWN_S
    for report in _steps(picture, wanted):
        start = time.monotonic()
        if start < due or report.partial is not None:
            yield report
            continue
        pixels = _shown_now(pixels, picture)
        now = time.monotonic()
        due = now + max(_SHOWN_S, _SHOWN_SHARE * (now - start))
        yield replace(report, partial=pixels)
    assert picture.buffers is not None
    pixels = _shown_now(pixels, picture)._replace(importance=picture.buffers.importance)
    yield Progress(1, 1, "Done", partial=pixels)


def fill_background(background: np.ndarray, camera: Camera, world: CubeMap | np.ndarray) -> Steps[None]:
    """Fill the background (P, 3) of a camera's pixels with a world."""
    if not isinstance(world, CubeMap):
        background[:] = world
        return
    directions = pixel_directions(camera)
    for first in range(0, len(background), _CACHED):
        yield Progress(first, len(background), "Sampling the world")
        background[first : first + _CACHED] = world.look(directions[first : first + _CACHED])


def show_again(pixels: LivePixels, exposure: float) -> None:
    """Show a finished picture over its background as that is now."""
    assert pixels.values is not None
    _show(pixels, exposure, len(pixels.values))


def _steps(picture: AdaptivePicture, wanted: PictureSettings) -> Steps[None]:
    yield from picture.trace(_PACE)
    for side in (REFINED_SIDE,) if picture.strategy is None else (_QUICK_SIDE, REFINED_SIDE):
        yield from wanted.more_rays(picture, _PACE, side)


def _shown_now(pixels: LivePixels, picture: AdaptivePicture) -> LivePixels:
    """Show the pixels that have a ray, which are all up to some row: others keep their squares."""
    width = picture.camera.width_px
    count = len(picture.samples) if picture.samples[-1] else int((picture.samples[::width] > 0).sum()) * width
    _show(pixels, picture.octree.exposure, count)
    return pixels._replace(traced=bool(picture.samples[-1]))


def _show(pixels: LivePixels, exposure: float, count: int) -> None:
    """Show the first `count` pixels; parts that fit into the processor's cache take half the time."""
    assert pixels.values is not None
    for part in (slice(first, min(first + _CACHED, count)) for first in range(0, count, _CACHED)):
        background = None if pixels.background is None else pixels.background[part]
        combined(pixels.values[part], exposure, background, pixels.shown.reshape(-1, 4)[part])


def _coarse_picture(octree: Octree, camera: Camera, world: World) -> np.ndarray:
    """(h, w, 4) float32 of single rays over the world, one for each square."""
    from ..tracing.render import first_hits, seen_above_white, seen_color

    columns, rows = (-(-side // COARSE) for side in (camera.width_px, camera.height_px))
    coarse = camera.with_size(columns, rows)
    hits = first_hits(octree, coarse)
    values = np.empty((len(hits.hit), 4), np.float32)
    values[:, :3] = seen_color(octree, hits.node, hits.direction) + seen_above_white(octree, hits)
    values[:, 3] = hits.hit
    behind = world.look(pixel_directions(coarse)) if isinstance(world, CubeMap) else world
    return combined(values, octree.exposure, behind).reshape(rows, columns, 4)


def _enlarge(coarse: np.ndarray, shown: np.ndarray) -> None:
    """Fill a picture (H, W, 4) with the squares of a coarse one."""
    (rows, columns, _), (height, width, _) = coarse.shape, shown.shape
    pixels = coarse.view(np.complex128)[..., 0]  # a pixel is moved as a whole
    wide = pixels[:, np.arange(width) * columns // width]
    np.take(wide, np.arange(height) * rows // height, axis=0, out=shown.view(np.complex128)[..., 0], mode="clip")
