# SPDX-License-Identifier: GPL-3.0-or-later
"""The world behind objects, in pictures, files and renders, against Cycles."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from patchnet.operators.cycles import environment
from patchnet.operators.cycles.background import Background, background, world_color
from patchnet.operators.cycles.daylight import SKY_COLOR, SKY_STRENGTH
from patchnet.operators.cycles.environment import MAP_SIDE_PX, SAMPLES, world_map, world_view
from patchnet.operators.render_engine.viewport_world import ViewportWorld, WorldBehind
from patchnet.operators.scene_access.window_job import in_window
from patchnet.operators.session import world_maps
from patchnet.operators.session.scene_session import KeyedMap, session_of
from patchnet.operators.session.world_maps import keep_map
from patchnet.patchnet_addon.image.comparison import picture_psnr
from patchnet.patchnet_addon.image.cube_map import CubeMap
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.tracing.camera import ORTHOGRAPHIC, Camera
from patchnet.tests.blender.engine_scene import build_for_engine, rendered
from patchnet.tests.blender.objects import active_camera
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot
from patchnet.tests.blender.shaders import world
from patchnet.tests.blender.worlds import SIZE, backdrop, gradient, photograph, shown_by_cycles, sky


def seen_by(camera: Camera) -> np.ndarray:
    """(P, 3) light that our background of the open scene has."""
    found = drain(background(bpy.context.evaluated_depsgraph_get(), camera, "world", baked=False))
    assert found.light is not None and found.warnings == ()
    return np.broadcast_to(found.light, (camera.pixel_count, 3))


@pytest.mark.parametrize(("world", "least"), [(gradient, 60.0), (sky, 40.0), (photograph, 35.0), (backdrop, 50.0)])
def test_the_background_is_what_cycles_renders(scene: bpy.types.Scene, world: Callable[[], None], least: float) -> None:
    world()
    scene.camera.data.shift_x, scene.camera.data.lens = 0.1, 20.0
    camera = active_camera(SIZE)
    before = scene_snapshot()
    found = seen_by(camera)
    assert_unchanged(before)
    assert picture_psnr(found, shown_by_cycles(camera)) > least


def test_an_orthographic_camera_sees_one_colour(scene: bpy.types.Scene) -> None:
    gradient()
    scene.camera.data.type = "ORTHO"
    camera = active_camera(SIZE)
    assert camera.kind == ORTHOGRAPHIC
    np.testing.assert_allclose(seen_by(camera), shown_by_cycles(camera, 4), atol=2e-3)


def test_a_world_that_cameras_do_not_see_is_black(scene: bpy.types.Scene) -> None:
    gradient()
    scene.world.cycles_visibility.camera = False
    camera = active_camera(SIZE)
    assert not seen_by(camera).any() and not shown_by_cycles(camera, 1).any()
    scene.world.cycles_visibility.camera, bpy.context.view_layer.use_sky = True, False
    assert not seen_by(camera).any() and not shown_by_cycles(camera, 1).any()


def test_beside_a_window_parts_are_short_and_stop_between_two(
    scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    gradient()
    camera = active_camera(SIZE)
    whole = seen_by(camera)
    monkeypatch.setattr(environment, "_PATHS_IN_WINDOW", 12 * SIZE[0] * SAMPLES)
    with in_window(True):
        assert picture_psnr(seen_by(camera), whole) > 55.0
        before = scene_snapshot()
        steps = world_view(scene.world, (1, 0.0), camera, SAMPLES)
        rows = [next(steps).done for _ in range(3)]
        assert rows == [0, 12, 24]
        assert_unchanged(before)
        steps.close()
    assert_unchanged(before)


def test_a_map_shows_all_directions(scene: bpy.types.Scene) -> None:
    gradient()
    known = drain(world_map(scene.world, (1, 0.0)))
    assert known.faces.shape == (6, MAP_SIDE_PX, MAP_SIDE_PX, 3)
    directions = np.random.default_rng(0).normal(size=(500, 3))
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    np.testing.assert_allclose(known.look(directions), 0.5 + 0.5 * unit, atol=4e-3)


def test_a_render_beside_a_window_waits_for_the_map(scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    gradient()
    camera = active_camera(SIZE)
    session_of(scene).world = KeyedMap("of another world", None)
    first = awaited(camera)
    assert first.light is not None and first.warnings == ()
    assert picture_psnr(first.light, seen_by(camera)) > 50.0
    kept = session_of(scene).world
    assert isinstance(kept, KeyedMap) and awaited(camera).warnings == () and session_of(scene).world is kept
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.5
    bpy.context.view_layer.update()
    half = awaited(camera).light
    assert half is not None and picture_psnr(2.0 * half, first.light) > 45.0
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.25
    bpy.context.view_layer.update()
    monkeypatch.setattr(world_maps, "_PATIENCE_S", 0.0)
    busy = awaited(camera)
    assert busy.light is not None and not busy.light.any() and "was busy for too long" in busy.warnings[0]
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
    gradient()
    first = behind()
    assert not first.world.any() and behind(changed=False).identity == first.identity and asked == [scene.name]
    drain(keep_map(scene.name))
    assert isinstance(behind(changed=False).world, CubeMap) and behind().identity != first.identity
    known = behind().identity
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.5
    assert behind().identity == known and asked == [scene.name] * 2, "as it was until there is another map"
    drain(keep_map(scene.name))
    assert behind().identity != known
    scene.render.film_transparent = True
    assert behind(changed=False).world is None


def test_a_scene_without_light_shows_the_sky_that_lights_it(scene: bpy.types.Scene) -> None:
    bpy.data.objects.remove(bpy.data.objects["Lamp"])
    scene.world = None
    depsgraph = bpy.context.evaluated_depsgraph_get()
    lit = drain(background(depsgraph, active_camera(SIZE), "AUTO", baked=True)).light
    np.testing.assert_allclose(lit, np.array(SKY_COLOR) * SKY_STRENGTH, rtol=1e-6)
    assert not drain(background(depsgraph, active_camera(SIZE), "AUTO", baked=False)).light.any()


def test_the_engine_renders_the_world_and_follows_film(registered: None, weights: Path, tmp_path: Path) -> None:
    scene = build_for_engine(weights, tmp_path)
    gradient()
    found = rendered(scene)["Combined"]
    scene.render.film_transparent = True
    over_nothing = rendered(scene)["Combined"]
    alpha = over_nothing[..., 3].reshape(-1, 1)
    assert (found[..., 3] == 1.0).all() and (alpha == 0.0).mean() > 0.1
    expected = over_nothing[..., :3].reshape(-1, 3) + (1.0 - alpha) * shown_by_cycles(active_camera())
    assert picture_psnr(found[..., :3].reshape(-1, 3), expected) > 55.0


def test_a_plain_colour_needs_no_cycles(scene: bpy.types.Scene) -> None:
    shine = world().nodes["Background"]
    shine.inputs["Color"].default_value, shine.inputs["Strength"].default_value = (0.1, 0.2, 0.4, 1.0), 0.5
    np.testing.assert_allclose(world_color(scene.world), (0.05, 0.1, 0.2), rtol=1e-6)
