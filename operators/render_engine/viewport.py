# SPDX-License-Identifier: GPL-3.0-or-later
"""Viewport shading mode: draw the preview of the view, or a message if there is none.

Whenever the engine of any scene is set, Blender ends the engines of all viewports and starts new ones. Rendering a map
of the world sets the engine of a temporary scene for each of its parts, and a picture that restarted each time would
never finish. So each engine hands its viewport's picture over to the next one.
"""

from __future__ import annotations

import time
from typing import Any

import bpy
import numpy as np

from ...patchnet_addon.runtime.errors import EngineGoneError, PatchNetError
from ...patchnet_addon.sampling.predicted import PREVIEW
from ...patchnet_addon.sampling.registry import strategy
from ...patchnet_addon.tracing.camera import Camera
from ..gpu_view import cards
from ..gpu_view.card_octree import CardOctree
from ..gpu_view.cards import CardError
from ..overlay.overlay_settings import (
    COMBINED,
    COVERAGE,
    LEVEL,
    PREDICTED_LIVE,
    PRIORITY,
    overlay_settings,
    overlay_state,
)
from ..overlay.paint import texture
from ..properties.preferences import apply_preferences, preferences
from ..scene.pixel_filter import pixel_filter_of
from ..scene_access.window_state import Part
from ..session import results
from ..session.scene_result import SceneResult
from ..session.scene_session import give_back
from ..settings.groups import picture_settings, samples_side
from .coarse_light import COARSE, is_coarse
from .render_camera import camera_rect, viewport_camera
from .viewport_card import CardHeat, CardPicture, HeatKind, strategy_on_card
from .viewport_mask import ViewportMask
from .viewport_preview import ViewportPreview
from .viewport_world import ViewportWorld, draw_message, draw_picture

_NO_VOXELS = "PatchNet: there are no voxels yet. Press Preview Selection in the sidebar's tab PatchNet (N)."
_NO_CODES = "PatchNet: look-ahead is not prepared yet. Press Prepare Look-Ahead in the sidebar's tab PatchNet (N)."
_READY_SOON = "PatchNet is getting ready"
_STALE = "the scene has changed: voxelize and bake again"
_KEPT_S = 1.0  # at least; at most twice as long


class Viewport:
    """State of one viewport between two drawings; dropping it frees its memory.

    region: address of the Blender region that it is drawn in, 0 before the first drawing. missed: its engine had ended
    by the last run of `_free`, and no engine has taken it over since.
    """

    def __init__(self) -> None:
        self.region = 0
        self.missed = False
        self._state: tuple[Any, ...] | None = None
        self._background: Any = None  # identity of the world that the preview shows
        self._preview: ViewportPreview | None = None
        self._texture: Any = None
        self._ended = False  # the engine, before it has shown a picture
        self._asked = 0.0  # time of the last request to redraw
        self._on_card: CardPicture | None = None
        self._heat: CardHeat | None = None
        self.mask, self.world = ViewportMask(), ViewportWorld()

    def updated(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Note a change of the scene that drawing does not detect."""
        self.world.updated(depsgraph)
        if depsgraph.id_type_updated("MESH"):
            self.mask.meshes_changed()

    def draw(self, engine: bpy.types.RenderEngine, context: bpy.types.Context, depsgraph: bpy.types.Depsgraph) -> None:
        """Work for a slice of time, draw the result, and request a redraw while work is left."""
        self.region = context.region.as_pointer()
        result = results.result_of(context.scene)
        if result is None:
            self._forget()
            self._on_card = self._heat = None
            cards.free_coming()
            self._message(engine, context, _NO_VOXELS)
            return
        try:
            self._draw(engine, context, depsgraph, result)
        except PatchNetError as error:
            self._forget()
            self._message(engine, context, f"PatchNet: {error}")

    def _draw(
        self,
        engine: bpy.types.RenderEngine,
        context: bpy.types.Context,
        depsgraph: bpy.types.Depsgraph,
        result: SceneResult,
    ) -> None:
        values, region = context.scene.patchnet, context.region
        needs_codes = strategy(values.strategy).needs or values.unrefined != PREVIEW
        if result.coded is None and needs_codes and not values.render_samples:
            self._forget()
            self._message(engine, context, _NO_CODES)
            return
        bounds = result.octree.grid.to_world(np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]))
        view = context.region_data
        camera = viewport_camera(view.view_matrix, view.window_matrix, (region.width, region.height), bounds)
        try:
            if self._draw_on_card(engine, context, depsgraph, result, camera):
                return
        except CardError as error:
            cards.give_up(result.octree, str(error))
            self._on_card = self._heat = None
        idle = self._preview is not None and self._preview.done
        if not self.mask.ready(context, idle=idle):
            self._message(engine, context, _READY_SOON)
            engine.tag_redraw()
            return
        preview = self._preview_of(context, depsgraph, result, camera)
        try:
            preview.work(time.perf_counter() - self._asked)  # as long as a redraw takes
        except EngineGoneError:
            if self._ended:
                raise  # it would end again and again
            self._ended, self._preview = True, None  # begun anew, since a job that is stopped may end the engine
        if preview.is_new:
            self._texture, self._ended = texture(preview.take(), "RGBA16F"), False
        if self._on_card is not None and not (preview.pixels and preview.pixels.traced):
            self._on_card.draw(context.region, engine, context.scene)  # better than a coarse picture
        elif self._texture is None:
            draw_message(context.region, _READY_SOON)
        else:  # of the view before, until there is one of this view
            draw_picture(self._texture, context.region, engine, context.scene)
        self._say(engine, context, preview.status, result, rests=preview.done)
        if not (idle and preview.done) or self.mask.waiting or cards.is_coming(result.octree):
            self._asked = time.perf_counter()  # once more at the end, for strokes painted meanwhile
            engine.tag_redraw()

    def _draw_on_card(
        self,
        engine: bpy.types.RenderEngine,
        context: bpy.types.Context,
        depsgraph: bpy.types.Depsgraph,
        result: SceneResult,
        camera: Camera,
    ) -> bool:
        """Draw by the graphics card while the view moves, and at rest too if all pixels get equally many samples.

        Returns whether nothing else draws: with priority or painted importance, and where the card has no room for
        the pieces on which rays end, CPU kernels continue at rest.
        """
        card = cards.card_of(context, result.octree)
        if card is None:
            self._on_card = self._heat = None
            return False
        values, picture = context.scene.patchnet, self._on_card or CardPicture()
        self._on_card = picture
        full = card.exact or result.octree.pieces is None
        alike = full and values.render_samples > 0 and self.mask.ready(context, idle=picture.done)
        alike = alike and self.mask.strokes is None
        side = samples_side(values.render_samples) if alike else 1
        behind = self.world.behind(depsgraph, result.octree)
        pixel_filter = pixel_filter_of(context.scene)
        key = id(result), side, pixel_filter, *_view(camera)
        moved = picture.look(card, key, camera, behind, side, pixel_filter)
        shows_heat = overlay_settings(context).live != COMBINED
        if not shows_heat:
            self._heat = None
        if not (alike or moved or shows_heat):
            return False
        picture.draw(context.region, engine, context.scene)
        status, done = picture.status if full else f"{picture.status}, surface in boxes", picture.done
        if shows_heat:
            status, heat_done = self._work_at_heat(context, card, result, camera)
            done = done and heat_done
        self._say(engine, context, status, result, rests=done and not moved)
        if alike or shows_heat:
            self._forget()
        if not done or moved or self.mask.waiting:
            engine.tag_redraw()
        return True

    def _work_at_heat(
        self, context: bpy.types.Context, card: CardOctree, result: SceneResult, camera: Camera
    ) -> tuple[str, bool]:
        """Continue the live heatmap, which the overlay draws; returns its status in words and whether it is done."""
        if result.coded is None:
            self._heat = None
            return _NO_CODES.removeprefix("PatchNet: "), True
        there, problem = cards.codes_on_card(result.coded)
        if not there:
            self._heat = None
            return problem or _READY_SOON, bool(problem)
        if self._heat is None:
            self._heat = overlay_state().heatmaps[self.region] = CardHeat()
        ranked_by, said = strategy_on_card(strategy(context.scene.patchnet.strategy), card)
        kind = (PRIORITY, COVERAGE, PREDICTED_LIVE, LEVEL).index(chosen := overlay_settings(context).live) + 1
        most = {PRIORITY: ranked_by.maximum, LEVEL: float(result.octree.depth)}.get(chosen, 1.0)
        wanted = HeatKind(kind, most, preferences(context).colormap, ranked_by)
        self._heat.look(card, result.coded, _view(camera), camera, wanted)
        return f"{said if chosen == PRIORITY else chosen.capitalize()}, 0 to {most:g}", self._heat.done

    def _preview_of(
        self, context: bpy.types.Context, depsgraph: bpy.types.Depsgraph, result: SceneResult, camera: Camera
    ) -> ViewportPreview:
        """Return the present preview if nothing that it depends on has changed, else a new one."""
        strokes = self.mask.strokes
        world, background = self.world.behind(depsgraph, result.octree)
        rect = None if strokes is None else camera_rect(context)
        wanted = picture_settings(context.scene.patchnet, pixel_filter_of(context.scene))
        state = id(result), wanted, self.mask.version, rect, *_view(camera)
        preview = self._preview
        if preview is not None and preview.octree is result.octree and preview.pixels is None:
            return preview  # a view that moves shows pictures, too
        if state != self._state or preview is None:
            if preview is None:
                apply_preferences(context)
            else:
                preview.close()
            preview = ViewportPreview(result.octree, result.coded, camera, wanted, world, strokes, rect)
            self._state, self._background, self._preview = state, background, preview
            self._asked = time.perf_counter()  # a short first slice: the first picture appears soon
        elif background != self._background:
            preview.show_world(world)
            self._background = background
        return preview

    def _say(
        self,
        engine: bpy.types.RenderEngine,
        context: bpy.types.Context,
        status: str,
        result: SceneResult,
        *,
        rests: bool,
    ) -> None:
        """Show the status, why the result is out of date, and whether its light is coarse here once the view rests."""
        said = [status, *([_STALE] if result.stale else [])]
        if rests and not result.stale and is_coarse(context, result):
            said.append(COARSE)
        engine.update_stats("PatchNet", ", ".join(said))

    def _message(self, engine: bpy.types.RenderEngine, context: bpy.types.Context, text: str) -> None:
        engine.update_stats("", text)
        draw_message(context.region, text)

    def _forget(self) -> None:
        if self._preview is not None:
            self._preview.close()
        self._state = self._preview = self._texture = None


def _view(camera: Camera) -> tuple[Any, ...]:
    """Key of a view: all values in which views can differ."""
    axes = (camera.position_world, camera.right, camera.up)
    lens = (camera.half_x, camera.half_y, camera.shift_x, camera.shift_y)
    return (*np.concatenate(axes).tolist(), *lens, camera.width_px, camera.height_px, camera.kind)


_left = Part("left_viewports", dict[int, Viewport])  # by the address of their region


def leave(viewport: Viewport) -> None:
    """Keep the viewport of an engine that ends, for a moment."""
    viewport.missed = False
    _left()[viewport.region] = viewport
    if not bpy.app.timers.is_registered(_free):
        bpy.app.timers.register(_free, first_interval=_KEPT_S, persistent=True)


def left_in(region: bpy.types.Region) -> Viewport | None:
    """Viewport of a region whose engine has just ended, or None."""
    viewport = _left().pop(region.as_pointer(), None)
    if viewport is not None:  # what has changed since was not reported
        viewport.world.forget()
        viewport.mask.meshes_changed()
    return viewport


def _free() -> float | None:
    """Free viewports already here at the last run: a redraw fits between two runs, however long work takes."""
    left = _left()
    gone = [region for region, viewport in left.items() if viewport.missed]
    for region in gone:
        del left[region]
    for viewport in left.values():
        viewport.missed = True
    if gone:
        give_back()  # a preview and its unfinished steps refer to each other
    return _KEPT_S if left else None


TIMERS = (_free,)
