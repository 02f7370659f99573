# SPDX-License-Identifier: GPL-3.0-or-later
"""The preview of a viewport without a window: slices of work end with the picture of a render."""

from types import SimpleNamespace

import numpy as np
import pytest

from patchnet.operators.render_engine import viewport as viewports
from patchnet.operators.render_engine.viewport import Viewport
from patchnet.operators.render_engine.viewport_preview import ViewportPreview
from patchnet.patchnet_addon.image.cube_map import FACES, CubeMap
from patchnet.patchnet_addon.image.live_picture import World
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.sampling.adaptive import AdaptivePicture, PictureSettings
from patchnet.patchnet_addon.sampling.passes import combined
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.tests.engine.octree_samples import random_octree

WORLD = np.array([0.1, 0.2, 1000.0], np.float32)
EYE = Camera.look_at(np.array([1.9, -1.1, 1.4]), np.full(3, 0.5), fov=0.8, size_px=(23, 17))
SETTINGS = PictureSettings("ss-variance", budget=0.4)


def new_picture() -> AdaptivePicture:
    return SETTINGS.picture(random_octree(), EYE, None, None)


def new_preview(world: World) -> ViewportPreview:
    return ViewportPreview(random_octree(), None, EYE, SETTINGS, world)


def shown(preview: ViewportPreview) -> np.ndarray:
    return preview.take().reshape(-1, 4)


def test_slices_end_with_the_picture_of_a_render() -> None:
    preview = new_preview(WORLD)
    while not preview.done:
        preview.work(0.0)
    picture = new_picture()
    drain(picture.trace())
    drain(picture.refine(0.4))
    assert preview.status == "Done" and preview.pixels is not None and preview.pixels.traced
    np.testing.assert_array_equal(preview.pixels.samples, picture.samples)
    np.testing.assert_array_equal(shown(preview), combined(picture.values, picture.octree.exposure, WORLD))


@pytest.mark.parametrize("slices", [0, 1, 3, None])
def test_a_map_that_comes_later_stands_behind_what_is_traced(slices: int | None) -> None:
    """After so many slices of work, or when all of it is done; the picture is not begun anew."""
    known = CubeMap(np.random.default_rng(1).random((len(FACES), 16, 16, 3)).astype(np.float16))
    at_once, later = new_preview(known), new_preview(WORLD)
    while not at_once.done:
        at_once.work(0.0)
    for _ in range(10_000 if slices is None else slices):
        if not later.done:
            later.work(0.0)
    before = later.pixels
    later.show_world(known)
    while not later.done:
        later.work(0.0)
    assert later.pixels is not None
    assert before is None or before.values is None or np.shares_memory(later.pixels.values, before.values)
    np.testing.assert_array_equal(shown(later), shown(at_once))
    later.show_world(WORLD)
    while not later.done:
        later.work(0.0)
    missed = later.pixels.values[:, 3] == 0.0
    assert missed.any() and (shown(later)[missed, :3] == WORLD).all()


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
