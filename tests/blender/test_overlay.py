# SPDX-License-Identifier: GPL-3.0-or-later
"""The overlay without a window: placement, values of pixels, kept views, named images."""

import dataclasses
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from patchnet.operators import overlay
from patchnet.operators.computing.views import ERROR_MAXIMUM
from patchnet.operators.overlay import drawing, open_pictures
from patchnet.operators.overlay import framed as layout
from patchnet.operators.overlay.framed import Rect
from patchnet.operators.pipeline.views import View, view
from patchnet.operators.scene.cameras import tracing_camera
from patchnet.operators.scene_access.own import quiet
from patchnet.operators.session import results, shown_view, views
from patchnet.operators.session.scene_session import session_of
from patchnet.operators.session.staleness import look_again
from patchnet.operators.session.views import PAGES, RAW, image_name, show_images
from patchnet.operators.settings.groups import ViewSettings
from patchnet.patchnet_addon.image.colormaps import colormap
from patchnet.patchnet_addon.image.heatmap import heatmap, places_on_page, with_legend
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.sampling.registry import STRATEGIES
from patchnet.tests.blender.job_scene import build, pixels_of, view_of

pytestmark = pytest.mark.usefixtures("registered")

SIZE = (24, 16)


@pytest.fixture(scope="module")
def made() -> tuple[View, ViewSettings]:
    """A view of the small scene; nothing of it is kept yet."""
    build()
    wanted = ViewSettings(size=SIZE, budget=0.4, refined_samples=1024.0)
    return view_of(bpy.context.scene, wanted), wanted


def window_matrix(camera: bpy.types.Object, size: tuple[int, int]) -> np.ndarray:
    """Projection of a viewport of that size that shows exactly what the camera's picture does."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    return np.array(camera.calc_matrix_camera(depsgraph, x=size[0], y=size[1]))


@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
@pytest.mark.parametrize("fit", ["AUTO", "HORIZONTAL", "VERTICAL"])
def test_frame_is_where_blender_has_it(kind: str, fit: str) -> None:
    build()
    scene, eye = bpy.context.scene, bpy.context.scene.camera
    scene.render.resolution_x, scene.render.resolution_y = 120, 80
    eye.data.type, eye.data.sensor_fit = kind, fit
    eye.data.shift_x, eye.data.shift_y = 0.2, -0.1
    camera = tracing_camera(eye, scene, SIZE)
    rect = layout.frame_rect(camera, window_matrix(eye, (120, 80)), 600, 400)
    np.testing.assert_allclose(rect, (0, 0, 600, 400), atol=1e-2)
    zoomed = np.diag([0.5, 0.5, 1.0, 1.0])  # of the viewport: half as large, and moved to the right
    zoomed[0, 3] = 0.25
    matrix = zoomed @ window_matrix(eye, (120, 80))
    rect = layout.frame_rect(camera, matrix, 600, 400)
    np.testing.assert_allclose(rect, (225, 100, 525, 300), atol=1e-2)
    if (kind, fit) == ("PERSP", "AUTO"):  # one of another aspect keeps its own
        eye.data.shift_x = eye.data.shift_y = 0.0
        rect = layout.frame_rect(tracing_camera(eye, scene, (20, 20)), window_matrix(eye, (120, 80)), 600, 400)
        np.testing.assert_allclose(rect, (0, -100, 600, 500), atol=1e-2)
    for nowhere in (np.diag([1.0, 1.0, 1.0, -1.0]), np.full((4, 4), np.nan)):
        assert layout.frame_rect(camera, nowhere, 600, 400) is None


def test_places_of_images_pixels_and_boxes() -> None:
    rect = layout.image_rect((-0.5, -1.0), (1.5, 1.0), 400, 300)
    np.testing.assert_allclose(rect, (100, 150, 300, 300))
    assert layout.image_rect((0, 0), (0, 1), 400, 300) is None
    rect = Rect(100, 50, 340, 210)  # 10 pixels of the region a pixel of the picture
    for point, pixel in (((100, 50), (0, 0)), ((109.9, 59.9), (0, 0)), ((110, 60), (1, 1)), ((339.9, 209.9), (23, 15))):
        assert layout.pixel_at(rect, SIZE, *point) == pixel
    for outside in ((99.9, 60), (340, 60), (200, 210), (200, 49)):
        assert layout.pixel_at(rect, SIZE, *outside) is None
    within = Rect(0, 0, 400, 300)
    for mouse, corner in (((100, 200), (110, 130)), ((390, 200), (300, 130)), ((100, 20), (110, 30))):
        assert layout.beside(mouse, (80, 60), 10, within) == corner


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("size", [(192, 128), (24, 16), (900, 700)])
def test_picture_is_found_on_its_page(size: tuple[int, int], count: int) -> None:
    marked = np.zeros((size[1], size[0]), np.float32)
    marked[0, 0] = marked[-1, -1] = 1.0
    page = heatmap(marked, 1.0, "priority")
    if count == 2:
        one = np.full((size[1], size[0], 3), 0.5, np.float32)
        one = one.repeat(max(1, round(540 / size[1])), axis=0).repeat(max(1, round(540 / size[1])), axis=1)
        page = with_legend([one, one], ["a", "b"], lambda place: colormap(place), ["", ""], "error")
    found = places_on_page((page.shape[1], page.shape[0]), size, count)
    assert len(found) == count
    if count == 1:
        sides = zip(found[0], page.shape[1::-1] * 2, strict=True)
        left, bottom, right, top = (round(share * side) for share, side in sides)
        factor = max(1, round(540 / size[1]))
        np.testing.assert_allclose(page[bottom, left], colormap(np.array(1.0)))
        np.testing.assert_allclose(page[top - 1, right - 1], colormap(np.array(1.0)))
        assert (right - left, top - bottom) == (size[0] * factor, size[1] * factor)
    assert places_on_page((page.shape[1] + 1, page.shape[0]), size, count) == ()


def test_what_is_known_of_a_pixel(made: tuple[View, ViewSettings]) -> None:
    result, wanted = made
    shown = shown_view.view_to_show(result, wanted, 0.0)
    buffers = result.buffers
    picture = {name: buffers.picture(values) for name, values in (("l1", buffers.preview), ("l32", buffers.reference))}
    np.testing.assert_array_equal(shown.values["preview luminance"], picture["l1"])
    refined = shown.values["samples"] == 1024
    assert refined.sum() == round(0.4 * buffers.active.sum())
    np.testing.assert_array_equal(shown.values["refined luminance"], np.where(refined, picture["l32"], picture["l1"]))
    miss = ~buffers.picture(buffers.hit)
    assert (shown.values["level"][miss] == -1).all() and (shown.values["level"][~miss] >= 0).all()
    row, column = np.argwhere(refined)[0]
    said = shown.describe_pixel(int(column), int(row), 0.25)
    assert said[0] == f"Pixel {column}, {row}" and said[-1] == "Samples 1024"
    assert said[1] == f"Priority {result.priority[row, column]:.4g} of 0.25"
    assert said[2] == f"Coverage {buffers.picture(buffers.prediction.coverage)[row, column]:.3f}"


def test_a_view_without_a_reference(made: tuple[View, ViewSettings]) -> None:
    """It has all but that and errors against it, which the overlay says instead."""
    result, wanted = made
    shown = shown_view.view_to_show(result, wanted, 0.0)
    assert [name for name in shown_view.TITLES if not shown.has(name)] == [shown_view.CYCLES_PICTURE]
    plain = drain(view(results.codes_of(bpy.context.scene), result.camera, wanted, "VISIBLE"))
    assert plain.errors is None and plain.buffers.reference is None
    np.testing.assert_array_equal(plain.refined.luminance, result.refined.luminance)
    np.testing.assert_array_equal(plain.priority, result.priority)
    blind = shown_view.view_to_show(plain, wanted, 0.0)
    missing = {name for name in shown_view.TITLES if not blind.has(name)} - {shown_view.CYCLES_PICTURE}
    assert missing == {"REFERENCE", "PREVIEW_ERROR", "PREDICTED_ERROR", "REFINED_ERROR"}
    assert not any("Reference" in line for line in blind.describe_pixel(3, 3, 0.25))


def test_heatmap_ends_at_the_configured_maximum(made: tuple[View, ViewSettings]) -> None:
    result, wanted = made
    own = STRATEGIES[wanted.strategy].maximum
    shown = shown_view.view_to_show(result, dataclasses.replace(wanted, heatmap_maximum=0.1), 0.0)
    assert shown.maximum_now(0.0) == 0.1  # as it was made
    assert shown.maximum_now(0.3) == 0.3  # as it was set since
    later = shown_view.view_to_show(result, dataclasses.replace(wanted, heatmap_maximum=0.1), 0.1)
    assert later.maximum_now(0.1) == 0.1 and later.maximum_now(0.0) == own
    np.testing.assert_array_equal(
        shown.picture("HEATMAP", 0.3, "turbo"), colormap(result.priority / np.float32(0.3), "turbo")
    )
    assert shown.legend("HEATMAP", 0.3)[0] == 0.3
    assert shown.legend("REFINED_ERROR", 0.3) == (ERROR_MAXIMUM, "luminance error")
    assert shown.legend("REFERENCE", 0.3) is None
    np.testing.assert_allclose(shown.picture("REFINED", 1.0, "viridis"), result.pictures["refined"], atol=0.51 / 255)


def test_images_are_named_after_the_camera(made: tuple[View, ViewSettings]) -> None:
    result, wanted = made
    shown = shown_view.view_to_show(result, wanted, 0.0)
    images = drain(show_images(result, shown))
    for name, count in PAGES.items():
        assert len(places_on_page(result.pictures[name].shape[1::-1], SIZE, count)) == count
    assert image_name("Eye", "priority") == "PatchNet Eye priority"
    for name in RAW:
        image = bpy.data.images[image_name("Eye", name)]
        assert image.is_float and image.colorspace_settings.name == "Non-Color" and tuple(image.size) == SIZE
        np.testing.assert_array_equal(pixels_of(image)[..., 0], shown.values[name])
    unknown = {name: values for name, values in shown.values.items() if name != "coverage"}
    with quiet():  # as in operators: removing an image makes Blender report every lamp
        drain(show_images(result, dataclasses.replace(shown, values=unknown)))
    assert image_name("Eye", "coverage") not in bpy.data.images
    assert "Coverage not computed" in dataclasses.replace(shown, values=unknown).describe_pixel(0, 0, 1.0)
    session_of(bpy.context.scene).views[shown.camera.name] = shown
    assert views.view_of_image(bpy.context.scene, images["heatmap"]) == (shown, "heatmap")
    assert views.view_of_image(bpy.context.scene, bpy.data.images.new("Own", 4, 4)) is None
    long = image_name("Ü" * 60, "reference luminance")
    assert len(long.encode()) <= 63 and long.endswith("reference luminance")
    assert image_name("C" * 60 + "1", "level") != image_name("C" * 60 + "2", "level")


def test_views_say_when_they_are_out_of_date(made: tuple[View, ViewSettings]) -> None:
    result, wanted = made
    scene = bpy.context.scene
    shown = shown_view.view_to_show(result, wanted, 0.0)
    session_of(scene).views[shown.camera.name] = shown
    assert views.why_stale(scene, shown) == ""
    where = scene.camera.location.x
    scene.camera.location.x += 0.5
    bpy.context.view_layer.update()
    assert views.why_stale(scene, shown) == "the camera changed"
    scene.camera.location.x = where
    bpy.context.view_layer.update()
    assert views.why_stale(scene, shown) == ""
    scene.camera.data.lens *= 2
    assert views.why_stale(scene, shown) == "the camera changed"
    scene.camera.data.lens /= 2
    bpy.data.objects["Slab"].location.x += 1.0
    bpy.context.view_layer.update()
    look_again(results.voxels_of(scene), scene)
    assert views.why_stale(scene, shown) == "'Slab' changed"
    bpy.ops.patchnet.voxelize(depth=6)
    assert views.why_stale(scene, shown) == "voxels were made anew"
    overlay.forget(bpy.context)
    assert not session_of(scene).views


def test_nothing_is_shown_in_background(made: tuple[View, ViewSettings]) -> None:
    result, wanted = made
    overlay.forget(bpy.context)
    drain(overlay.show(bpy.context, [result], wanted))
    assert not session_of(bpy.context.scene).views
    assert not bpy.ops.patchnet.inspect_pixels.poll()
    open_pictures.open_picture(bpy.context, bpy.data.images.new("Any", 4, 4))
    assert open_pictures.may_replace(None)
    assert not open_pictures.may_replace(bpy.data.images.new("Painting", 4, 4))


@pytest.mark.parametrize("kind", ["VIEW_3D", "IMAGE_EDITOR"])
def test_show_overlays_hides_ours_too(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Region by region, as the handlers call it."""
    looked: list[str] = []
    monkeypatch.setattr(drawing, "framed", lambda scene, area, region: looked.append(area.type))
    values = SimpleNamespace(show_viewport=True, show_editor=True)
    monkeypatch.setattr(drawing, "overlay_settings", lambda context: values)
    space = SimpleNamespace(overlay=SimpleNamespace(show_overlays=False))
    area = SimpleNamespace(type=kind, spaces=SimpleNamespace(active=space))
    context = SimpleNamespace(scene=bpy.context.scene, area=area, region=bpy.context.scene)
    drawing.draw_region(context)
    assert looked == []
    space.overlay.show_overlays = True
    drawing.draw_region(context)
    assert looked == [kind]
    values.show_viewport = values.show_editor = False
    drawing.draw_region(context)
    assert looked == [kind]
