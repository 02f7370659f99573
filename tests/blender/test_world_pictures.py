# SPDX-License-Identifier: GPL-3.0-or-later
"""The world in pictures of a job: exposure, view transform and alpha."""

import json
from pathlib import Path

import bpy
import numpy as np

from patchnet.operators.overlay.paint import texels
from patchnet.operators.pipeline.views import save_view
from patchnet.operators.scene_access.images import unlike_view
from patchnet.operators.session.shown_view import REFINED, view_to_show
from patchnet.operators.settings.groups import ViewSettings
from patchnet.patchnet_addon.image.comparison import picture_psnr
from patchnet.patchnet_addon.image.tone import srgb_encode
from patchnet.tests.blender.job_scene import pixels_in, pixels_of
from patchnet.tests.blender.shaders import image, world
from patchnet.tests.blender.worlds import SIZE, gradient, run, shown_by_cycles


def test_pictures_say_which_view_transform_they_have(scene: bpy.types.Scene, weights: Path, tmp_path: Path) -> None:
    """A pixel of known value in a saved picture is what Blender saves by Standard, whatever the scene's view is."""
    world().nodes["Background"].inputs["Color"].default_value = (0.18, 0.5, 0.9, 1.0)
    bpy.context.view_layer.update()
    saved = {}
    for name in ("Standard", "AgX", "Filmic"):
        scene.view_settings.view_transform = name
        made = run(weights=weights, exposure=1.0)
        save_view(made.views[0], tmp_path / name)
        row, column = np.argwhere(made.views[0].buffers.picture(~made.views[0].buffers.hit))[0]
        saved[name] = pixels_in(tmp_path / name / "preview.png")[row, column, :3]
        assert made.report["view_transform"] == "Standard"
        assert unlike_view(scene) == ("" if name == "Standard" else f"Pictures are Standard, F12 is {name}")
        blenders = saved_by_blender(scene, (0.18, 0.5, 0.9), tmp_path / f"{name}.png")
        assert (np.abs(saved[name] - blenders).max() < 1.5 / 255) == (name == "Standard"), (name, saved[name], blenders)
    np.testing.assert_array_equal(saved["AgX"], saved["Standard"])
    scene.view_settings.view_transform, scene.view_settings.exposure = "Standard", 1.0
    assert unlike_view(scene) == "Pictures are Standard, F12 is Standard with its settings"


def saved_by_blender(scene: bpy.types.Scene, light: tuple[float, float, float], path: Path) -> np.ndarray:
    """Encoded colour (3,) of linear light in a picture that Blender saves by the scene's view."""
    known = image("Known", np.broadcast_to([*light, 1.0], (4, 4, 4)))
    if hasattr(scene.render.image_settings, "media_type"):
        scene.render.image_settings.media_type = "IMAGE"
    scene.render.image_settings.file_format = "PNG"
    known.save_render(str(path), scene=scene)
    return pixels_in(path)[0, 0, :3]


def test_pictures_of_a_job_show_the_world_in_their_exposure(scene: bpy.types.Scene, weights: Path) -> None:
    gradient()
    bpy.context.scene.cycles.pixel_filter_type = "BOX"  # so that rays count in their own pixel alone
    made = run(weights=weights, exposure=0.5, reference=True)
    black = run(weights=weights, exposure=0.5, reference=True, background="black")
    view, other = made.views[0], black.views[0]
    assert view.errors == other.errors and view.report["mse_unrefined"] == other.report["mse_unrefined"]
    missed = view.buffers.picture(~view.buffers.hit & (view.refined.samples == 1))
    behind = view.buffers.picture(srgb_encode(0.5 * shown_by_cycles(view.camera)))
    assert missed.mean() > 0.1
    for name in ("preview", "predicted", "refined"):
        assert picture_psnr(view.pictures[name][missed], behind[missed]) > 40.0
        assert not other.pictures[name][missed].any()
    met = view.buffers.picture(view.buffers.hit)
    np.testing.assert_array_equal(view.pictures["preview"][met], other.pictures["preview"][met])
    alpha = view.buffers.picture(view.refined.alpha)
    partly = (alpha > 0.1) & (alpha < 0.9)
    assert partly.sum() > 10
    expected = view.buffers.picture(view.refined.colors) + (1.0 - alpha)[..., None] * 0.5 * view.buffers.picture(
        view.background
    )
    np.testing.assert_allclose(view.pictures["refined"][partly], srgb_encode(expected)[partly], atol=1e-5)
    sampled = view.buffers.picture(view.buffers.reference_alpha)
    np.testing.assert_allclose(sampled[view.buffers.picture(view.refined.samples) == 1024],
                               alpha[view.buffers.picture(view.refined.samples) == 1024], atol=1e-6)  # fmt: skip


def test_transparent_pictures_have_alpha_in_files(scene: bpy.types.Scene, weights: Path, tmp_path: Path) -> None:
    gradient()
    made = run(weights=weights, out=tmp_path / "out", background="transparent")
    view = made.views[0]
    folder = tmp_path / "out" / json.loads((tmp_path / "out" / "report.json").read_text())["frames"][0]["folder"]
    refined = bpy.data.images.load(str(folder / "refined.png"))
    assert refined.depth == 32
    found = pixels_of(refined).reshape(-1, 4)
    np.testing.assert_allclose(found[:, 3], view.refined.alpha, atol=0.5 / 255 + 1e-6)
    solid = view.refined.alpha == 1.0
    np.testing.assert_allclose(found[solid, :3], srgb_encode(view.refined.colors)[solid], atol=0.5 / 255 + 1e-6)
    assert bpy.data.images.load(str(folder / "heatmap.png")).depth == 24


def test_the_overlay_draws_pictures_with_alpha(scene: bpy.types.Scene, weights: Path) -> None:
    for behind, share in (("transparent", 0.1), ("world", 0.0)):
        view = run(weights=weights, background=behind).views[0]
        shown = view_to_show(view, ViewSettings(), 0.0)
        drawn = texels(shown.picture(REFINED, 1.0, "viridis"))
        assert drawn.shape == (SIZE[1], SIZE[0], 4) and (drawn[..., 3] == 0.0).mean() >= share
        assert share > 0.0 or (drawn[..., 3] == 1.0).all()


def test_as_film_follows_the_scene(scene: bpy.types.Scene, weights: Path) -> None:
    gradient()
    scene.render.film_transparent = True
    assert run(weights=weights).views[0].pictures["refined"].shape[-1] == 4
    assert run(weights=weights, background="world").views[0].pictures["refined"].shape[-1] == 3
