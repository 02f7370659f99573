# SPDX-License-Identifier: GPL-3.0-or-later
"""The preview of a viewport without a window: slices of work end with the picture of a render."""

from types import SimpleNamespace

import numpy as np
import pytest

from patchnet.operators.render_engine import viewport as viewports
from patchnet.operators.render_engine.passes import combined
from patchnet.operators.render_engine.viewport import Viewport
from patchnet.operators.render_engine.viewport_preview import ViewportPreview
from patchnet.patchnet_addon.image.cube_map import FACES, CubeMap
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.sampling.adaptive import AdaptivePicture
from patchnet.patchnet_addon.sampling.registry import STRATEGIES
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.tests.engine.octree_samples import random_octree

WORLD = np.array([0.1, 0.2, 1000.0], np.float32)


def new_picture() -> AdaptivePicture:
    eye = Camera.look_at(np.array([1.9, -1.1, 1.4]), np.full(3, 0.5), fov=0.8, size_px=(23, 17))
    return AdaptivePicture(random_octree(), eye, STRATEGIES["ss-variance"])


def test_slices_end_with_the_picture_of_a_render() -> None:
    preview = ViewportPreview(new_picture(), 0.4, WORLD)
    while not preview.done:
        preview.work(0.0)
    picture = new_picture()
    drain(picture.trace())
    drain(picture.refine(0.4))
    assert preview.status == "Done"
    np.testing.assert_array_equal(preview.picture.samples, picture.samples)
    np.testing.assert_array_equal(preview.pixels().reshape(-1, 4), combined(picture, WORLD))


@pytest.mark.parametrize("slices", [0, 1, 3, None])
def test_a_map_that_comes_later_stands_behind_what_is_traced(slices: int | None) -> None:
    """After so many slices of work, or when all of it is done; the picture is not begun anew."""
    known = CubeMap(np.random.default_rng(1).random((len(FACES), 16, 16, 3)).astype(np.float16))
    at_once, later = ViewportPreview(new_picture(), 0.4, known), ViewportPreview(new_picture(), 0.4, WORLD)
    drain(at_once.steps)
    for _ in range(10_000 if slices is None else slices):
        if not later.done:
            later.work(0.0)
    before = later.picture.ranking
    later.show_world(known)
    while not later.done:
        later.work(0.0)
    assert before is None or later.picture.ranking is before
    np.testing.assert_array_equal(later.pixels(), at_once.pixels())
    later.show_world(WORLD)
    later.work(0.0)
    missed = later.picture.alpha == 0.0
    assert later.done and missed.any() and (later.pixels().reshape(-1, 4)[missed, :3] == WORLD).all()


def test_a_viewport_is_left_to_the_next_engine_of_its_region(registered: None) -> None:
    """For as long as one or two looks at the time, of which drawing comes between."""
    viewport = Viewport()
    viewport.region = 17
    region, other = (SimpleNamespace(as_pointer=lambda at=at: at) for at in (17, 18))
    for looks in (0, 1):
        viewports.leave(viewport)
        for _ in range(looks):
            viewports._free()
        assert viewports.left_in(other) is None
        assert viewports.left_in(region) is viewport
        assert viewports.left_in(region) is None
    viewports.leave(viewport)  # left again between two looks: time begins anew
    viewports._free()
    assert viewports.left_in(region) is viewport
    viewports.leave(viewport)
    viewports._free()
    assert viewports.left_in(region) is viewport
    viewports.leave(viewport)
    for _ in range(2):
        viewports._free()
    assert viewports.left_in(region) is None
