# SPDX-License-Identifier: GPL-3.0-or-later
"""Drawing of the overlay in a region: two sides of a wipe, titles, legends, marks, and the pixel under the mouse."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from ...patchnet_addon.export.fine_light import noise_text
from ...patchnet_addon.image.colormaps import colormap
from ...patchnet_addon.runtime import log
from ..properties.preferences import preferences
from ..scene_access.images import VIEW_TRANSFORM, unlike_view
from ..session import views
from ..session.scene_session import session_of
from ..session.shown_view import CYCLES_PICTURE, TITLES, ShownView
from . import paint
from .framed import EDITORS, Rect, beside, framed, free_rect
from .overlay_settings import NOTHING, overlay_settings, overlay_state

NO_REFERENCE = "No reference yet: Compare Strategies traces it"
NOT_REFINED = "Not rendered yet: press Refine with Cycles"
_LEGEND_PX, _BAR_PX, _GAP_PX = 190, 9, 8
_RAMP_STOPS = 52
NO_VIEW = "There are no pictures yet: run Render Preview first"


@dataclass(frozen=True)
class _Look:
    """Values to draw a view with; seen: part of its rectangle inside the region and not below bars."""

    view: ShownView
    maximum: float
    colormap: str
    scale: float
    transform: str  # view transform of the pictures, if the scene's is another
    seen: Rect

    @property
    def gap(self) -> float:
        """Margin around texts, in pixels."""
        return _GAP_PX * self.scale


def draw_region(context: bpy.types.Context) -> None:
    """Draw the overlay into the current region, unless the editor's Show Overlays is off."""
    area, region, values, state = context.area, context.region, overlay_settings(context), overlay_state()
    if area is None or area.type not in EDITORS:
        return
    heat = state.heatmaps.get(region.as_pointer()) if area.type == "VIEW_3D" else None
    if heat is not None and heat.shown is not None and area.spaces.active.shading.type == "RENDERED":
        whole = Rect(0, 0, region.width, region.height)
        paint.picture(heat.shown, whole, whole, 1.0)
    wanted = values.show_viewport if area.type == "VIEW_3D" else values.show_editor
    if wanted and area.spaces.active.overlay.show_overlays:
        found = framed(context.scene, area, region)
        if found is not None and len(found.rects) == 1:
            _draw_overlay(context, found.view, found.rects[0])
    for pixel in state.inspected.values():
        if pixel is not None and pixel.region == region.as_pointer():
            scale = context.preferences.system.ui_scale
            size = paint.box_size(pixel.lines, scale)
            corner = beside((pixel.x, pixel.y), size, 14 * scale, free_rect(area, region))
            paint.box(pixel.lines, corner, scale)


def _draw_overlay(context: bpy.types.Context, view: ShownView, rect: Rect) -> None:
    values = overlay_settings(context)
    whole = free_rect(context.area, context.region)
    look = _Look(
        view,
        view.maximum_now(context.scene.patchnet.heatmap_maximum),
        preferences(context).colormap,
        context.preferences.system.ui_scale,
        f" ({VIEW_TRANSFORM})" if unlike_view(context.scene) else "",
        rect.meet(whole),
    )
    middle = rect.left + values.wipe * rect.width if values.use_wipe else rect.right
    sides = [(values.picture, rect._replace(right=middle)), (values.other, rect._replace(left=middle))]
    sides = sides[: 2 if values.use_wipe else 1]
    missing = [name for name, _ in sides if name != NOTHING and not view.has(name)]
    sides = [(NOTHING if name in missing else name, part) for name, part in sides]
    for name, part in sides:
        if name != NOTHING:
            texture = paint.textures().of_view(view, name, look.maximum, look.colormap)
            paint.picture(texture, rect, part, values.opacity)
    if values.use_wipe:
        half = max(look.scale, 1.0)
        paint.fill(Rect(middle - half, rect.bottom, middle + half, rect.top), paint.INK)
    if look.seen.empty:
        return
    if values.legend:
        for index, (name, part) in enumerate(sides):
            if not part.meet(whole).empty:
                _draw_title(look, name, right_side=index == 1)
                _draw_legend(look, name, right_side=index == 1)
    if stale := views.why_stale(context.scene, view):
        _draw_mark(look, f"Out of date: {stale}", "Out of date", values.legend)
    elif missing:
        by_cycles = missing[0] == CYCLES_PICTURE
        mark = (NOT_REFINED, "Not refined") if by_cycles else (NO_REFERENCE, "No reference")
        _draw_mark(look, *mark, values.legend)
    elif (result := session_of(context.scene).result) is not None and result.unfinished:
        noise = noise_text(result.octree)
        _draw_mark(look, f"Light of noise {noise}, to be refined", f"Noise {noise}", values.legend)


def _left(look: _Look, width: float, right_side: bool) -> float:
    """Left edge of an item of that width in the left or the right corner."""
    return look.seen.right - look.gap - width if right_side else look.seen.left + look.gap


def _draw_title(look: _Look, name: str, right_side: bool) -> None:
    """Draw the title in the upper corner of a side."""
    title = TITLES.get(name, "Below") + (look.transform if name in look.view.looks else "")
    width, height = paint.box_size([title], look.scale)
    if width + 2 * look.gap <= look.seen.width / 2:
        paint.box([title], (_left(look, width, right_side), look.seen.top - look.gap - height), look.scale)


def _draw_legend(look: _Look, name: str, right_side: bool) -> None:
    """Draw a bar of colours from 0 to the configured maximum, with ticks, numbers and the quantity, if it has one."""
    legend = look.view.legend(name, look.maximum) if name != NOTHING else None
    if legend is None:
        return
    scale, gap, (maximum, quantity) = look.scale, look.gap, legend
    quantity_width, line = paint.text_size(quantity, scale)
    width = max(_LEGEND_PX * scale, quantity_width + 2 * gap)
    height = 2 * line + _BAR_PX * scale + 2.5 * gap
    if width + 2 * gap > look.seen.width or height + 2 * gap > look.seen.height / 2:
        return  # the picture is too small to cover it
    x, y = _left(look, width, right_side), look.seen.bottom + gap
    paint.fill(Rect(x, y, x + width, y + height), paint.GROUND)
    bar = Rect(x + 2 * gap, y + height - gap - _BAR_PX * scale, x + width - 2 * gap, y + height - gap)
    paint.ramp(bar, [(*color, 1.0) for color in colormap(np.linspace(0, 1, _RAMP_STOPS), look.colormap).tolist()])
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        tick = bar.left + share * bar.width
        paint.fill(Rect(tick - 0.5 * scale, bar.bottom - 3 * scale, tick + 0.5 * scale, bar.bottom), paint.INK)
        if share in (0.0, 0.5, 1.0):
            text = f"{maximum * share:.3g}"
            text_width = paint.text_size(text, scale)[0]
            left = min(max(tick - text_width / 2, x + 2), x + width - text_width - 2)
            paint.write(text, left, bar.bottom - 4 * scale - 0.8 * line, scale)
    paint.write(quantity, x + (width - quantity_width) / 2, y + 0.6 * gap, scale)


def _draw_mark(look: _Look, text: str, short: str, below_title: bool) -> None:
    """Draw a warning below the title, or `short` where there is no room for the `text`."""
    width, height = paint.box_size([text], look.scale)
    down = look.gap + (height + look.gap if below_title else 0.0) + height
    said = text if width + 2 * look.gap <= look.seen.width else short
    paint.box([said], (look.seen.left + look.gap, look.seen.top - down), look.scale, paint.WARNING)


def _draw() -> None:
    """Draw in the current region; the first error switches the overlay off, as each redraw would repeat it."""
    state = overlay_state()
    if state.problem:
        return
    try:
        draw_region(bpy.context)
    except Exception as error:  # noqa: BLE001  any error would come again with every redraw
        state.problem = f"The overlay cannot be drawn and is switched off: {error}"
        log.unexpected(error)


def register() -> None:
    """Add the draw handlers of viewports and Image Editors."""
    for space in (bpy.types.SpaceView3D, bpy.types.SpaceImageEditor):
        handle = space.draw_handler_add(_draw, (), "WINDOW", "POST_PIXEL")
        overlay_state().handles.append((space, handle))


def unregister() -> None:
    """Remove the draw handlers."""
    for space, handle in overlay_state().handles:
        space.draw_handler_remove(handle, "WINDOW")
