# SPDX-License-Identifier: GPL-3.0-or-later
"""Progressive refinement: chosen pixels, parts of a camera, bands of rows."""

from dataclasses import replace

import numpy as np
import pytest

from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.patchnet_addon.runtime.progress import Progress, Steps, drain
from patchnet.patchnet_addon.sampling.adaptive import AdaptivePicture, Pace
from patchnet.patchnet_addon.sampling.pixel_buffers import PixelBuffers
from patchnet.patchnet_addon.sampling.refine import refined_mask, refinement_order
from patchnet.patchnet_addon.sampling.registry import STRATEGIES
from patchnet.patchnet_addon.sampling.trace import trace_view
from patchnet.patchnet_addon.tracing.camera import ORTHOGRAPHIC, Camera, camera_part
from patchnet.patchnet_addon.tracing.pixel_filter import BOX_FILTER, EVEN_FOOTPRINT, rook_places
from patchnet.patchnet_addon.tracing.render import first_hits
from patchnet.patchnet_addon.tracing.supersample import spread_pixels, supersample, supersample_pixels
from patchnet.tests.engine.octree_samples import random_octree

CHOSEN = STRATEGIES["ss-variance"]


def camera(width: int = 23, height: int = 17) -> Camera:
    return Camera.look_at(np.array([1.9, -1.1, 1.4]), np.full(3, 0.5), fov=0.8, size_px=(width, height))


def colored(octree: Octree) -> Octree:
    chroma = np.random.default_rng(1).integers(30, 100, (octree.node_count, 2), dtype=np.uint8)
    return replace(octree, chroma=chroma)


def test_coverage_is_the_share_of_rays_that_hit() -> None:
    octree, eye = random_octree(), camera()
    every = np.arange(eye.pixel_count)
    white = replace(octree, luminance=np.full_like(octree.luminance, 65535))
    coverage = supersample_pixels(octree, eye, every, 4).coverage
    np.testing.assert_allclose(coverage, drain(supersample(white, eye, 4)).luminance, atol=1e-6)
    assert ((coverage > 0.0) & (coverage < 1.0)).any()


@pytest.mark.parametrize("kind", ["PERSP", ORTHOGRAPHIC])
def test_a_part_of_a_camera_has_the_same_rays(kind: str) -> None:
    whole = Camera(**vars(camera()) | {"kind": kind, "shift_x": 0.3, "shift_y": -0.2})
    part = camera_part(whole, 4, 3, 9, 11)
    octree = random_octree()
    place = (np.arange(3, 14)[:, None] * whole.width_px + np.arange(4, 13)).ravel()
    one, other = first_hits(octree, whole), first_hits(octree, part)
    np.testing.assert_allclose(other.direction, one.direction[place], atol=1e-6)
    np.testing.assert_array_equal(other.node, one.node[place])
    assert camera_part(whole, 0, 0, 23, 17) is whole
    with pytest.raises(SettingError, match="render border"):
        camera_part(whole, 4, 3, 0, 11)


def test_the_most_urgent_pixels_come_first() -> None:
    picture = AdaptivePicture(random_octree(), camera(), CHOSEN)
    drain(picture.trace())
    steps = picture.refine(1.0, pace=Pace(batch_rays=5 * 1024))
    next(steps), next(steps)
    done = picture.samples > 1
    assert done.sum() == 5
    assert picture.ranking.score[done].min() >= picture.ranking.score[~done].max()


def test_an_even_picture_has_as_many_fine_rays_in_every_pixel() -> None:
    octree, eye = colored(random_octree()), camera()
    picture = AdaptivePicture(octree, eye, None)
    drain(picture.trace(Pace(band_pixels=50)))
    assert picture.ranking is None and (picture.samples == 1).all()
    drain(picture.sample_evenly(4, Pace(batch_rays=500)))
    assert (picture.samples == 16).all()
    every = np.arange(eye.pixel_count)
    plain = spread_pixels(octree, eye, every, rook_places(4), BOX_FILTER, finer=EVEN_FOOTPRINT).given[:, 0]
    np.testing.assert_allclose(picture.values[:, :3], plain[:, :3], atol=1e-6)
    coarse = spread_pixels(octree, eye, every, rook_places(4), BOX_FILTER).given[:, 0]
    assert np.abs(plain - coarse).max() > 0.01, "rays of a quarter of a pixel meet coarser voxels"
    reports = []
    drain(picture.sample_evenly(4), reports.append)
    assert not reports, "all have theirs"


def halves(buffers: PixelBuffers) -> Steps[np.ndarray]:
    """Half of what is on the left matters, nothing on the right."""
    yield Progress(0, 1, "Looking")
    return np.tile(np.where(np.arange(buffers.width) < buffers.width // 2, 0.5, 0.0), buffers.height).astype(np.float32)


@pytest.mark.parametrize("budget", [0.2, 1.0])
def test_importance_ranks_and_leaves_out(budget: float) -> None:
    octree, eye = random_octree(), camera()
    picture = AdaptivePicture(octree, eye, CHOSEN, importance=halves)
    assert picture.ranking is None
    drain(picture.trace(Pace(band_pixels=50)))
    drain(picture.refine(budget))
    buffers = drain(trace_view(octree, eye, [CHOSEN]))
    score = CHOSEN.scores(buffers)
    buffers = replace(buffers, importance=drain(halves(buffers)))
    mask = refined_mask(buffers, refinement_order(buffers, score), budget)
    np.testing.assert_array_equal(picture.samples, np.where(mask, 1024, 1))
    np.testing.assert_array_equal(picture.ranking.priority, score * buffers.importance)
    assert 0 < mask.sum() < buffers.active.sum() and not mask[buffers.importance == 0].any()
