# SPDX-License-Identifier: GPL-3.0-or-later
"""Use the render engine on the graphics card in a window: turn, zoom, quad view, heatmaps, free memory.

    blender --enable-event-simulate -p 0 0 1300 700 yard.blend -P card_window.py -- OUT NAME SECONDS

SECONDS: how long two viewports turn, saved meanwhile; from a minute on the visit does nothing else.

Writes OUT/NAME.json and screenshots beside it; test_card_window.py judges them.
"""

import sys
import time
from pathlib import Path

import bpy
import numpy as np
from mathutils import Quaternion

sys.path.insert(0, str(Path(__file__).parent))
import clicks
from visits import OUT, Visit, choose, engine, made, module, preferences, result, watched

NAME, TURNED_S = sys.argv[-2], float(sys.argv[-1])
visit = Visit(NAME)
seen = visit.seen
viewports: list = []


def prefer(viewport: str) -> None:
    preferences().viewport = viewport
    clicks.area("VIEW_3D").tag_redraw()


def settled() -> bool:
    """Whether all viewports that are there have all samples of the card."""
    return bool(viewports) and all(viewport._on_card is not None and viewport._on_card.done for viewport in viewports)


def rested() -> bool:
    """Whether any viewport has all samples of the card: others may have ended."""
    return any(viewport._on_card is not None and viewport._on_card.done for viewport in viewports)


def begun_anew(viewport) -> clicks.Session:
    """Wait until a viewport takes samples of another view, and has them all."""
    yield from clicks.wait_for(lambda: not viewport._on_card.done, "another view", 30.0)
    yield from clicks.wait_for(lambda: viewport._on_card.done, "all samples of it", 180.0)


def picture():
    """The card shows what a render has: the same rays, the same footprints."""
    space = clicks.area("VIEW_3D").spaces.active
    space.region_3d.view_perspective = "CAMERA"
    space.overlay.show_overlays = False
    space.shading.type = "RENDERED"
    yield from clicks.wait_for(settled, "all samples of the first view", 240.0)
    (viewport,) = viewports
    yield from clicks.wait_for(lambda: viewport._on_card._background not in (None, "no map"), "the world's map", 120.0)
    yield from clicks.wait_for(settled, "all samples before the world", 180.0)
    seen["by the CPU"] = viewport._preview is not None
    texture = viewport._on_card._images[2]
    data = texture.read()
    data.dimensions = texture.width * texture.height * 4
    found = np.frombuffer(data, np.float32).reshape(-1, 4)
    seen["differences"] = compared(viewport, found, (texture.width, texture.height))


def compared(viewport, found: np.ndarray, size: tuple[int, int]) -> list[float]:
    """Share of pixels that differ by more than a grade of the screen from the CPU's preview, and the mean."""
    previews, views = module("render_engine.viewport_preview"), module("render_engine.viewport")
    area = clicks.area("VIEW_3D")
    view = area.spaces.active.region_3d
    octree = result().octree
    bounds = octree.grid.to_world(np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]))
    camera = views.viewport_camera(view.view_matrix, view.window_matrix, size, bounds)
    world = viewport.world.behind(bpy.context.evaluated_depsgraph_get(), octree).world
    settings = previews.PictureSettings(None, side=4, pixel_filter=views.pixel_filter_of(bpy.context.scene))
    preview = previews.ViewportPreview(octree, None, camera, settings, world)
    while not preview.done:
        preview.work(1.0)
    off = np.abs(preview.take().reshape(-1, 4) - found).max(axis=1)
    return [float((off > 1 / 255).mean()), float(off.mean())]


def moves():
    """Orbit and zoom: each is another picture; frames while the view moves are single rays."""
    (viewport,) = viewports
    view = clicks.area("VIEW_3D").spaces.active.region_3d
    view.view_perspective = "PERSP"
    yield from begun_anew(viewport)
    x, y = clicks.over_viewport()
    yield from clicks.move(x, y)
    clicks.window().event_simulate(type="WHEELUPMOUSE", value="PRESS", x=x, y=y)
    yield from begun_anew(viewport)
    start, frames = time.monotonic(), 0
    for _ in range(40):
        view.view_rotation = Quaternion((0.0, 0.0, 1.0), 0.05) @ view.view_rotation
        before = viewport._on_card._view
        clicks.area("VIEW_3D").tag_redraw()
        yield 0.01
        frames += viewport._on_card._view != before
    seen["turning frames/s"] = frames / (time.monotonic() - start)
    yield from clicks.wait_for(settled, "all samples after turning", 180.0)
    view.view_perspective = "ORTHO"
    yield from begun_anew(viewport)


def split():
    """Quad view: four viewports of one octree on the card."""
    area, pane = clicks.area("VIEW_3D"), clicks.region("WINDOW")
    with bpy.context.temp_override(window=clicks.window(), area=area, region=pane):
        bpy.ops.screen.region_quadview()
    yield from clicks.wait_for(lambda: len(viewports) >= 4 and settled(), "four views have all samples", 240.0)
    seen["octrees on the card"] = len(module("gpu_view.cards")._cards())
    with bpy.context.temp_override(window=clicks.window(), area=area, region=clicks.region("WINDOW")):
        bpy.ops.screen.region_quadview()
    yield 3.0


def far() -> None:
    """A view from so far away that it looks ahead, with the line about what is shown."""
    space = clicks.area("VIEW_3D").spaces.active
    space.region_3d.view_perspective, space.region_3d.view_distance = "PERSP", 20.0
    space.shading.type, space.overlay.show_overlays = "RENDERED", True


def heat():
    """The live heatmap: at half the resolution first, over the picture; what needs codes says so."""
    overlay = bpy.context.window_manager.patchnet_overlay
    far()
    overlay.live = "PRIORITY"
    yield 3.0
    bpy.ops.patchnet.precompute_codes()
    for kind in ("PRIORITY", "COVERAGE", "PREDICTED", "LEVEL"):
        overlay.live = kind
        yield from clicks.wait_for(lambda: any(v._heat and not v._heat.done for v in viewports), f"{kind} begins")
        yield from clicks.wait_for(lambda: any(v._heat and v._heat.done for v in viewports), f"{kind} is done", 240.0)
        yield from clicks.screenshot(OUT / f"{NAME}-{kind.lower()}.png")
    seen["priority by"] = [v._heat._wanted[1].ranked_by.name for v in viewports if v._heat]
    yield from inspect()


def turning():
    """Two viewports turn with heatmaps and pictures."""
    overlay = bpy.context.window_manager.patchnet_overlay
    far()
    if result().coded is None:
        bpy.ops.patchnet.precompute_codes()
    overlay.live = "PRIORITY"
    yield from two_views()
    seen["turned"] = yield from turned(TURNED_S)
    yield from clicks.screenshot(OUT / f"{NAME}-two.png")
    join()
    overlay.live = "COMBINED"
    yield from clicks.wait_for(lambda: viewports and not any(v._heat for v in viewports if v._on_card), "no heatmap")


def inspect():
    """Values of the pixel in the middle of the view, over the heatmap."""
    inspected, pane = module("overlay.overlay_settings").overlay_state().inspected, clicks.region("WINDOW")
    x, y = pane.x + pane.width // 2, pane.y + pane.height // 2
    yield from clicks.move(x, y)
    with bpy.context.temp_override(window=clicks.window(), area=clicks.area("VIEW_3D"), region=pane):
        bpy.ops.patchnet.inspect_pixels("INVOKE_DEFAULT")
    yield from clicks.move(x + 3, y)
    yield 0.5
    seen["inspected"] = [pixel.lines for pixel in inspected.values() if pixel]
    yield from clicks.screenshot(OUT / f"{NAME}-inspect.png")
    yield from clicks.key("ESC", x, y)
    yield 0.5


def views() -> list:
    return [area for area in clicks.window().screen.areas if area.type == "VIEW_3D"]


def two_views():
    """Another viewport beside the first one."""
    with bpy.context.temp_override(window=clicks.window(), area=clicks.area("VIEW_3D")):
        bpy.ops.screen.area_split(direction="VERTICAL", factor=0.5)
    yield 1.0
    for area in views():
        area.spaces.active.shading.type = "RENDERED"
    heats = module("overlay.overlay_settings").overlay_state().heatmaps
    yield from clicks.wait_for(lambda: sum(heat.shown is not None for heat in heats.values()) >= 2, "two heatmaps")


def join() -> None:
    with bpy.context.temp_override(window=clicks.window(), area=views()[-1]):
        bpy.ops.screen.area_close()
    viewports.clear()  # that of the area has ended


def turned(seconds: float):
    """Turn all viewports for a while, each by the heatmap and by the picture in turns, and save now and then.

    Returns frames, saves, and each second the seconds so far and bytes of the process.
    """
    resident_bytes = engine("runtime.memory").resident_bytes
    overlay, path = bpy.context.window_manager.patchnet_overlay, str(OUT / f"{NAME}.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    start, frames, saves, taken = time.monotonic(), 0, 0, []
    while (spent := time.monotonic() - start) < seconds:
        for area in views():
            view = area.spaces.active.region_3d
            view.view_rotation = Quaternion((0.0, 0.0, 1.0), 0.05) @ view.view_rotation
            area.tag_redraw()
        frames += 1
        if len(taken) <= spent:
            taken.append((round(spent, 1), resident_bytes()))
            overlay.live = ("PRIORITY", "PRIORITY", "COMBINED", "PREDICTED")[len(taken) // 5 % 4]
        if saves <= spent / 8:
            bpy.ops.wm.save_mainfile()
            saves += 1
        yield 0.01
    return {"frames": frames, "saves": saves, "memory": taken}


def by_priority():
    """The CPU goes on at rest."""
    choose(render_samples=0.0, budget=0.02)
    clicks.window().scene.update_tag()
    clicks.area("VIEW_3D").tag_redraw()
    yield from clicks.wait_for(lambda: any(v._preview is not None and v._preview.done for v in viewports), "CPU", 240.0)
    seen["refined by the CPU"] = max(int(v._preview.pixels.samples.max()) for v in viewports if v._preview)
    choose(render_samples=16.0)


def ended_exactly(viewport) -> bool:
    preview = viewport._preview
    return preview is not None and preview.done and preview.octree.pieces is not None


def no_room():
    """The card has room for voxels alone: the CPU goes on at rest, with rays that end on the surface."""
    octree, values = result().octree, preferences()
    card_bytes, allowed = module("gpu_view.packing").card_bytes, values.card_gib
    assert card_bytes(octree) > 1.01 * card_bytes(octree.without_pieces())
    values.card_gib = 1.001 * card_bytes(octree.without_pieces()) / (1 << 30)
    clicks.area("VIEW_3D").tag_redraw()
    cards = module("gpu_view.cards")._cards()
    yield from clicks.wait_for(lambda: (card := cards[octree].octree) and not card.exact, "boxes on the card", 60.0)
    yield from clicks.wait_for(lambda: any(ended_exactly(v) for v in viewports), "CPU", 120.0)
    seen["exact by the CPU"] = True
    values.card_gib = allowed
    clicks.area("VIEW_3D").tag_redraw()
    yield from clicks.wait_for(rested, "the surface by the card", 120.0)


def workspaces():
    """Another workspace and back: the viewport is another one of Blender's each time."""
    window, before = clicks.window(), clicks.window().workspace
    window.workspace = bpy.data.workspaces["Scripting"]
    yield 2.0
    window.workspace = before
    yield 1.0
    clicks.area("VIEW_3D").tag_redraw()
    yield from clicks.wait_for(rested, "back again")
    seen["octrees after workspaces"] = len(module("gpu_view.cards")._cards())


def freed():
    """Free Memory frees the card, too."""
    viewports.clear()  # those of the quad view have ended
    bpy.ops.patchnet.clear_results()
    yield from clicks.wait_for(lambda: not module("gpu_view.cards")._cards(), "nothing is on the card", 30.0)


def reloaded():
    """Voxels again, and another file, which frees them; nothing crashes."""
    made("voxelize", "bake_light")
    clicks.area("VIEW_3D").tag_redraw()
    yield from clicks.wait_for(lambda: module("gpu_view.cards").is_there(result().octree), "on the card again", 60.0)
    sessions = module("session.scene_session")
    # The world's map first: what makes it holds the session.
    yield from clicks.wait_for(lambda: sessions.session_of(clicks.window().scene).world is not None, "a map", 120.0)
    viewports.clear()
    bpy.ops.wm.open_mainfile(filepath=bpy.data.filepath)
    yield 3.0
    module("session.scene_session").give_back()
    seen["octrees after another file"] = len(module("gpu_view.cards")._cards())
    made("voxelize", "bake_light")  # of the file that was saved while the view turned
    for area in views():
        area.spaces.active.shading.type = "RENDERED"  # a file opens in Solid
    yield from clicks.wait_for(rested, "all samples in the file that was saved", 300.0)
    yield from clicks.screenshot(OUT / f"{NAME}-saved.png")


def session():
    """The whole visit."""
    scene = clicks.window().scene
    scene.render.engine = "PATCHNET"
    prefer("CARD")
    choose(
        resolution="DEPTH", depth=8, scope="VISIBLE", light="two-lights", color=True, render_samples=16.0, shape="exact"
    )
    watched(viewports)
    made("voxelize", "bake_light")
    seen["card"] = module("gpu_view.cards").BlenderDevice().name
    parts = picture, moves, split, heat, turning, by_priority, no_room, workspaces, freed, reloaded
    yield from visit.parts(*(parts if TURNED_S < 60 else (turning, reloaded)))


visit.play(session())
