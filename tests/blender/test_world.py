# SPDX-License-Identifier: GPL-3.0-or-later
"""The world behind objects, in pictures, files and renders, against Cycles' own pictures of it."""

import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from patchnet.operators.cycles import environment
from patchnet.operators.cycles.background import Background, background, world_color
from patchnet.operators.cycles.camera_render import combined_light
from patchnet.operators.cycles.daylight import SKY_COLOR, SKY_STRENGTH
from patchnet.operators.cycles.environment import MAP_SIDE_PX, SAMPLES, world_map, world_view
from patchnet.operators.cycles.render_call import render
from patchnet.operators.cycles.scene_copy import prepared
from patchnet.operators.overlay.paint import texels
from patchnet.operators.pipeline.run import JobResult, run_job
from patchnet.operators.pipeline.views import save_view
from patchnet.operators.render_engine.viewport_preview import ViewportPreview
from patchnet.operators.render_engine.viewport_world import ViewportWorld, WorldBehind
from patchnet.operators.scene.cameras import choose_cameras
from patchnet.operators.scene_access.blender_version import start_nodes
from patchnet.operators.scene_access.images import unlike_view
from patchnet.operators.scene_access.window_job import in_window
from patchnet.operators.session import world_maps
from patchnet.operators.session.scene_session import KeyedMap, session_of
from patchnet.operators.session.shown_view import REFINED, view_to_show
from patchnet.operators.session.world_maps import keep_map
from patchnet.operators.settings.groups import ViewSettings
from patchnet.operators.settings.job_settings import JobSettings
from patchnet.patchnet_addon.image.comparison import psnr
from patchnet.patchnet_addon.image.cube_map import CubeMap, pixel_directions
from patchnet.patchnet_addon.image.exr import read_exr
from patchnet.patchnet_addon.image.tone import srgb_encode
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.sampling.adaptive import AdaptivePicture
from patchnet.patchnet_addon.sampling.registry import STRATEGIES
from patchnet.patchnet_addon.tracing.camera import ORTHOGRAPHIC, Camera
from patchnet.tests.blender.engine_scene import build_for_engine, rendered
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot

SIZE = (48, 32)


def nodes_of_world(scene: bpy.types.Scene) -> tuple[bpy.types.NodeTree, bpy.types.Node]:
    """A new world of the scene: its nodes, and the one that shines."""
    scene.world = bpy.data.worlds.new("World")
    tree = start_nodes(scene.world)
    return tree, next(node for node in tree.nodes if node.type == "BACKGROUND")


def gradient(scene: bpy.types.Scene) -> None:
    """Red to the right, green ahead, blue above, each from 0 to 1."""
    tree, shine = nodes_of_world(scene)
    place, half = tree.nodes.new("ShaderNodeTexCoord"), tree.nodes.new("ShaderNodeVectorMath")
    half.operation, half.inputs[1].default_value, half.inputs[2].default_value = "MULTIPLY_ADD", [0.5] * 3, [0.5] * 3
    tree.links.new(place.outputs["Generated"], half.inputs[0])
    tree.links.new(half.outputs[0], shine.inputs["Color"])


def sky(scene: bpy.types.Scene) -> None:
    """A sky texture with its sun in the picture."""
    tree, shine = nodes_of_world(scene)
    texture = tree.nodes.new("ShaderNodeTexSky")
    texture.sun_elevation, texture.sun_rotation, texture.sun_size = 0.15, 0.1, 0.2
    tree.links.new(texture.outputs[0], shine.inputs["Color"])
    shine.inputs["Strength"].default_value = 0.1


def photograph(scene: bpy.types.Scene) -> None:
    """An environment texture of 64 x 32 pixels."""
    tree, shine = nodes_of_world(scene)
    image = bpy.data.images.new("Photograph", 64, 32, float_buffer=True)
    image.pixels.foreach_set(np.random.default_rng(1).random(64 * 32 * 4, np.float32))
    texture = tree.nodes.new("ShaderNodeTexEnvironment")
    texture.image = image
    tree.links.new(texture.outputs[0], shine.inputs["Color"])


def backdrop(scene: bpy.types.Scene) -> None:
    """Cameras see a gradient over the picture, all other rays a gray that lights."""
    tree, shine = nodes_of_world(scene)
    path, mix = tree.nodes.new("ShaderNodeLightPath"), tree.nodes.new("ShaderNodeMixRGB")
    place = tree.nodes.new("ShaderNodeTexCoord")
    mix.inputs["Color1"].default_value = (0.3, 0.3, 0.3, 1.0)
    tree.links.new(path.outputs["Is Camera Ray"], mix.inputs["Fac"])
    tree.links.new(place.outputs["Window"], mix.inputs["Color2"])
    tree.links.new(mix.outputs[0], shine.inputs["Color"])


def camera_of(scene: bpy.types.Scene) -> Camera:
    depsgraph = bpy.context.evaluated_depsgraph_get()
    return choose_cameras(depsgraph, (), SIZE, np.array([[-1.0] * 3, [1.0] * 3]))[0]


def shown_by_cycles(camera: Camera, samples: int = 64) -> np.ndarray:
    """(P, 3) light of the world alone, as Cycles renders it through a camera."""
    hidden = [item for item in bpy.context.scene.objects if not item.hide_render and item.type == "MESH"]
    for item in hidden:
        item.hide_render = True
    try:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "world.exr"
            with prepared(bpy.context, camera, samples, 1, path) as (scene, _):
                scene.render.film_transparent = False
                render(scene, path)
            return combined_light(read_exr(path)).reshape(-1, 3)
    finally:
        for item in hidden:
            item.hide_render = False


def seen_by(camera: Camera) -> np.ndarray:
    """(P, 3) light that our background of the open scene has."""
    found = drain(background(bpy.context.evaluated_depsgraph_get(), camera, "world", baked=False))
    assert found.light is not None and found.warnings == ()
    return np.broadcast_to(found.light, (camera.pixel_count, 3))


@pytest.mark.parametrize(("world", "least"), [(gradient, 60.0), (sky, 40.0), (photograph, 35.0), (backdrop, 50.0)])
def test_the_background_is_what_cycles_renders(
    scene: bpy.types.Scene, world: Callable[[bpy.types.Scene], None], least: float
) -> None:
    world(scene)
    scene.camera.data.shift_x, scene.camera.data.lens = 0.1, 20.0
    camera = camera_of(scene)
    found = psnr(seen_by(camera), shown_by_cycles(camera))
    print(f"\n{world.__name__}: {found:.1f} dB")
    assert found > least


def test_an_orthographic_camera_sees_one_colour(scene: bpy.types.Scene) -> None:
    gradient(scene)
    scene.camera.data.type = "ORTHO"
    camera = camera_of(scene)
    assert camera.kind == ORTHOGRAPHIC
    np.testing.assert_allclose(seen_by(camera), shown_by_cycles(camera, 4), atol=2e-3)


def test_a_world_that_cameras_do_not_see_is_black(scene: bpy.types.Scene) -> None:
    gradient(scene)
    scene.world.cycles_visibility.camera = False
    camera = camera_of(scene)
    assert not seen_by(camera).any() and not shown_by_cycles(camera, 1).any()


def test_looking_at_the_world_leaves_everything_as_it_was(scene: bpy.types.Scene) -> None:
    gradient(scene)
    before = scene_snapshot()
    seen_by(camera_of(scene))
    assert_unchanged(before)


def test_large_pictures_are_baked_in_parts(scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    gradient(scene)
    camera = camera_of(scene)
    whole = seen_by(camera)
    monkeypatch.setattr("patchnet.operators.cycles.environment._PART_PX", 7 * SIZE[0])
    assert psnr(seen_by(camera), whole) > 55.0


def test_beside_a_window_parts_are_short_and_stop_between_two(
    scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    gradient(scene)
    camera = camera_of(scene)
    whole = seen_by(camera)
    monkeypatch.setattr(environment, "_FIRST_PATHS", 12 * SIZE[0] * SAMPLES)
    with in_window(True):
        assert psnr(seen_by(camera), whole) > 55.0
        before = scene_snapshot()
        steps = world_view(scene.world, (1, 0.0), camera, SAMPLES)
        rows = [next(steps).done for _ in range(3)]
        assert rows[:2] == [0, 3] and rows[2] > 3
        assert_unchanged(before)
        steps.close()
    assert_unchanged(before)


@pytest.mark.parametrize(
    ("reading", "each", "least", "most"),
    [(1.0, 1e-6, 500_000, 1_500_000), (0.0, 1e-5, 30_000, 50_000), (0.1, 1e-3, 10_000, 10_000)],
)
def test_parts_are_short_but_where_reading_the_world_takes_longer(
    reading: float, each: float, least: int, most: int
) -> None:
    parts = environment.Parts(10_000)
    for _ in range(20):
        parts.took(parts.pixels, reading + each * parts.pixels)
    assert least <= parts.pixels <= most


def test_a_map_shows_all_directions(scene: bpy.types.Scene) -> None:
    gradient(scene)
    known = drain(world_map(scene.world, (1, 0.0)))
    assert known.faces.shape == (6, MAP_SIDE_PX, MAP_SIDE_PX, 3)
    directions = np.random.default_rng(0).normal(size=(500, 3))
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    np.testing.assert_allclose(known.look(directions), 0.5 + 0.5 * unit, atol=4e-3)


def test_a_render_beside_a_window_waits_for_the_map(scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    gradient(scene)
    camera = camera_of(scene)
    session_of(scene).world = KeyedMap("of another world", None)
    first = awaited(camera)
    assert first.light is not None and first.warnings == ()
    assert psnr(first.light, seen_by(camera)) > 50.0
    kept = session_of(scene).world
    assert isinstance(kept, KeyedMap) and awaited(camera).warnings == () and session_of(scene).world is kept
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.5
    bpy.context.view_layer.update()
    half = awaited(camera).light
    assert half is not None and psnr(2.0 * half, first.light) > 45.0
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.25
    bpy.context.view_layer.update()
    monkeypatch.setattr(world_maps, "_PATIENCE_S", 0.0)
    busy = awaited(camera)
    assert busy.light is not None and not busy.light.any() and "too busy" in busy.warnings[0]
    session = session_of(scene)
    session.free()
    assert session.world is None


def awaited(camera: Camera) -> Background:
    """Background of a render that waits, while the window's timer works."""
    steps = world_maps.awaited_background(bpy.context.evaluated_depsgraph_get(), camera, baked=False)
    try:
        while True:
            next(steps)
            world_maps._make_maps()
    except StopIteration as stop:
        found: Background = stop.value
        return found
    finally:
        if bpy.app.timers.is_registered(world_maps._make_maps):
            bpy.app.timers.unregister(world_maps._make_maps)


def test_a_viewport_shows_colours_at_once_and_a_sky_as_soon_as_there_is_a_map(
    scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []
    monkeypatch.setattr("patchnet.operators.render_engine.viewport_world.ask_for_map", lambda of: asked.append(of.name))
    viewport, lit = ViewportWorld(), SimpleNamespace(provenance={"light": "cycles"})

    def behind(changed: bool = True) -> WorldBehind:
        bpy.context.view_layer.update()
        if changed:
            viewport._known = None  # as Blender's updates of a window do
        return viewport.behind(bpy.context.evaluated_depsgraph_get(), lit)

    scene.world = None
    assert not behind().world.any() and not asked, "a lamp lights, so that no sky of ours is there"
    gradient(scene)
    first = behind()
    assert not first.world.any() and behind(changed=False).identity == first.identity and asked == [scene.name]
    drain(keep_map(scene))
    assert isinstance(behind(changed=False).world, CubeMap) and behind().identity != first.identity
    known = behind().identity
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.5
    assert behind().identity == known and asked == [scene.name] * 2, "as it was until there is another map"
    drain(keep_map(scene))
    assert behind().identity != known
    scene.render.film_transparent = True
    assert behind(changed=False).world is None


def test_a_preview_with_a_map_is_that_of_its_pixels(scene: bpy.types.Scene, weights: Path) -> None:
    gradient(scene)
    made = run(weights=weights)
    camera, octree = made.views[0].camera, made.coded.octree
    known = drain(world_map(scene.world, (1, 0.0)))
    picture = AdaptivePicture(octree, camera, STRATEGIES["ss-variance"])
    preview = ViewportPreview(picture, 0.1, known)
    drain(preview.steps)
    missed = picture.alpha == 0.0
    found = preview.pixels().reshape(-1, 4)[missed]
    assert missed.any() and (found[:, 3] == 1.0).all()
    np.testing.assert_allclose(found[:, :3], known.look(pixel_directions(camera))[missed], atol=1e-6)


def run(**values: object) -> JobResult:
    settings = JobSettings.of(depth=6, size=SIZE, light="two-lights", budget=0.5, **values)
    return drain(run_job(bpy.context, settings))


def test_pictures_say_which_view_transform_they_have(scene: bpy.types.Scene, weights: Path, tmp_path: Path) -> None:
    """A pixel of known value in a saved picture is what Blender saves by Standard, whatever the scene's view is."""
    nodes_of_world(scene)[1].inputs["Color"].default_value = (0.18, 0.5, 0.9, 1.0)
    bpy.context.view_layer.update()
    saved = {}
    for name in ("Standard", "AgX", "Filmic"):
        scene.view_settings.view_transform = name
        made = run(weights=weights, exposure=1.0)
        save_view(made.views[0], tmp_path / name)
        row, column = np.argwhere(made.views[0].buffers.picture(~made.views[0].buffers.hit))[0]
        saved[name] = read_png(tmp_path / name / "preview.png")[row, column, :3]
        assert made.report["view_transform"] == "Standard"
        assert unlike_view(scene) == ("" if name == "Standard" else f"Pictures are Standard, F12 is {name}")
        blenders = saved_by_blender(scene, (0.18, 0.5, 0.9), tmp_path / f"{name}.png")
        assert (np.abs(saved[name] - blenders).max() < 1.5 / 255) == (name == "Standard"), (name, saved[name], blenders)
    np.testing.assert_array_equal(saved["AgX"], saved["Standard"])
    scene.view_settings.view_transform, scene.view_settings.exposure = "Standard", 1.0
    assert unlike_view(scene) == "Pictures are Standard, F12 is Standard with its settings"


def saved_by_blender(scene: bpy.types.Scene, light: tuple[float, float, float], path: Path) -> np.ndarray:
    """Encoded colour (3,) of linear light in a picture that Blender saves by the scene's view."""
    image = bpy.data.images.new("Known", 4, 4, float_buffer=True)
    image.pixels.foreach_set(np.tile(np.array([*light, 1.0], np.float32), 16))
    if hasattr(scene.render.image_settings, "media_type"):
        scene.render.image_settings.media_type = "IMAGE"
    scene.render.image_settings.file_format = "PNG"
    image.save_render(str(path), scene=scene)
    return read_png(path)[0, 0, :3]


def read_png(path: Path) -> np.ndarray:
    """(H, W, 4) encoded colours of a file."""
    image = bpy.data.images.load(str(path))
    pixels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    return pixels.reshape(image.size[1], image.size[0], 4)


def test_pictures_of_a_job_show_the_world_in_their_exposure(scene: bpy.types.Scene, weights: Path) -> None:
    gradient(scene)
    made = run(weights=weights, exposure=0.5, reference=True)
    black = run(weights=weights, exposure=0.5, reference=True, background="black")
    view, other = made.views[0], black.views[0]
    assert (
        view.errors == other.errors
        and view.report["frames" if "frames" in view.report else "mse_unrefined"] == (other.report["mse_unrefined"])
    )
    missed = view.buffers.picture(~view.buffers.hit & (view.refined.samples == 1))
    behind = view.buffers.picture(srgb_encode(0.5 * shown_by_cycles(view.camera)))
    assert missed.mean() > 0.1
    for name in ("preview", "predicted", "refined"):
        assert psnr(view.pictures[name][missed], behind[missed]) > 40.0
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


def test_gray_pictures_show_the_worlds_luminance(scene: bpy.types.Scene, weights: Path) -> None:
    gradient(scene)
    made = run(weights=weights, exposure=1.0, color=False).views[0]
    missed = made.buffers.picture(~made.buffers.hit)
    pixels = made.pictures["preview"][missed]
    assert (pixels[:, 0] == pixels[:, 1]).all() and pixels.std() > 0.01


def test_transparent_pictures_have_alpha_in_files(scene: bpy.types.Scene, weights: Path, tmp_path: Path) -> None:
    gradient(scene)
    made = run(weights=weights, out=tmp_path / "out", background="transparent")
    view = made.views[0]
    folder = tmp_path / "out" / json.loads((tmp_path / "out" / "report.json").read_text())["frames"][0]["folder"]
    image = bpy.data.images.load(str(folder / "refined.png"))
    assert image.depth == 32
    pixels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    found = pixels.reshape(-1, 4)
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
    gradient(scene)
    scene.render.film_transparent = True
    assert run(weights=weights).views[0].pictures["refined"].shape[-1] == 4
    assert run(weights=weights, background="world").views[0].pictures["refined"].shape[-1] == 3


def test_a_scene_without_light_shows_the_sky_that_lights_it(scene: bpy.types.Scene) -> None:
    for lamp in [item for item in scene.objects if item.type == "LIGHT"]:
        bpy.data.objects.remove(lamp)
    scene.world = None
    depsgraph = bpy.context.evaluated_depsgraph_get()
    lit = drain(background(depsgraph, camera_of(scene), "AUTO", baked=True)).light
    np.testing.assert_allclose(lit, np.array(SKY_COLOR) * SKY_STRENGTH, rtol=1e-6)
    assert not drain(background(depsgraph, camera_of(scene), "AUTO", baked=False)).light.any()


def test_the_engine_renders_the_world_and_follows_film(registered: None, weights: Path, tmp_path: Path) -> None:
    scene = build_for_engine(weights, tmp_path)
    gradient(scene)
    found = rendered(scene)["Combined"]
    scene.render.film_transparent = True
    over_nothing = rendered(scene)["Combined"]
    alpha = over_nothing[..., 3].reshape(-1, 1)
    assert (found[..., 3] == 1.0).all() and (alpha == 0.0).mean() > 0.1
    camera = choose_cameras(bpy.context.evaluated_depsgraph_get(), (), (0, 0), np.zeros((2, 3)))[0]
    expected = over_nothing[..., :3].reshape(-1, 3) + (1.0 - alpha) * shown_by_cycles(camera)
    assert psnr(found[..., :3].reshape(-1, 3), expected) > 55.0


def test_a_plain_colour_needs_no_cycles(scene: bpy.types.Scene) -> None:
    _, shine = nodes_of_world(scene)
    shine.inputs["Color"].default_value, shine.inputs["Strength"].default_value = (0.1, 0.2, 0.4, 1.0), 0.5
    np.testing.assert_allclose(world_color(scene.world), (0.05, 0.1, 0.2), rtol=1e-6)
