# SPDX-License-Identifier: GPL-3.0-or-later
"""Drawing of the overlay in a region: two sides of a wipe, titles, legends, marks, and the pixel under the mouse."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from ...patchnet_addon.image.colormaps import colormap
from ..properties.preferences import preferences
from ..scene_access.images import VIEW_TRANSFORM, unlike_view
from ..session import views
from ..session.scene_session import InspectedPixel, session_of
from ..session.shown_view import CYCLES_PICTURE, TITLES, ShownView
from . import paint
from .framed import EDITORS, Framed, framed, free_rect
from .layout import Rect, beside, sides_of_wipe, tick_values
from .overlay_settings import NOTHING, overlay_settings
from .paint import texture_of

NO_REFERENCE = "No reference yet: Compare Strategies traces it"
NOT_REFINED = "Not there yet: Refine with Cycles renders it"
_LEGEND_PX = 190
_BAR_PX = 9
_GAP_PX = 8
_RAMP_STOPS = 52


@dataclass(frozen=True)
class _Look:
    """Look of a view as it is drawn now."""

    view: ShownView
    maximum: float
    colormap: str
    scale: float
    transform: str  # said of light, where the scene's view is another


def draw_region(context: bpy.types.Context) -> None:
    """Draw the overlay into the region that is being drawn, unless the editor's Show Overlays is off."""
    area, region, values = context.area, context.region, overlay_settings(context)
    if area is None or area.type not in EDITORS:
        return
    if area.spaces.active.overlay.show_overlays and (
        values.show_viewport if area.type == "VIEW_3D" else values.show_editor
    ):
        found = framed(context.scene, area, region)
        if found is not None and found.rect is not None:
            _draw_overlay(context, found, found.rect)
    for pixel in list(session_of(context.scene).inspected.values()):
        if pixel.region == region.as_pointer():
            _draw_inspected(context, pixel)


def maximum_of(scene: bpy.types.Scene, view: ShownView) -> float:
    """Priority at the end of the legend, as the scene's settings have it now."""
    return view.maximum_now(scene.patchnet.heatmap_maximum)


def _draw_overlay(context: bpy.types.Context, found: Framed, rect: Rect) -> None:
    values, view = overlay_settings(context), found.view
    look = _Look(
        view,
        maximum_of(context.scene, view),
        preferences(context).colormap,
        context.preferences.system.ui_scale,
        f" ({VIEW_TRANSFORM})" if unlike_view(context.scene) else "",
    )
    whole = free_rect(context.area, context.region)
    left, right = sides_of_wipe(rect, values.wipe) if values.use_wipe else (rect, rect._replace(left=rect.right))
    sides = [(values.picture, left)] + ([(values.other, right)] if values.use_wipe else [])
    missing = [name for name, _ in sides if name != NOTHING and not view.has(name)]
    sides = [(NOTHING if name in missing else name, part) for name, part in sides]
    for name, part in sides:
        if name != NOTHING:
            texture = texture_of(view, name, look.maximum, look.colormap)
            paint.picture(texture, rect, part, values.opacity)
    if values.use_wipe:
        half = max(look.scale, 1.0)
        paint.fill(Rect(left.right - half, rect.bottom, left.right + half, rect.top), paint.INK)
    seen = rect.meet(whole)
    if seen.empty:
        return
    if values.legend:
        for index, (name, part) in enumerate(sides):
            _draw_side(look, name, seen, right_side=index == 1, shown=not part.meet(whole).empty)
    if stale := views.why_stale(context.scene, view):
        _draw_mark(f"Out of date: {stale}", "Out of date", seen, look.scale, values.legend)
    elif missing:
        by_cycles = missing[0] == CYCLES_PICTURE
        mark = (NOT_REFINED, "Not refined") if by_cycles else (NO_REFERENCE, "No reference")
        _draw_mark(*mark, seen, look.scale, values.legend)


def _draw_side(look: _Look, name: str, seen: Rect, *, right_side: bool, shown: bool) -> None:
    """Title in the upper corner of a side, legend in its lower corner."""
    if not shown:
        return
    gap = _GAP_PX * look.scale
    title = TITLES.get(name, "Below") + (look.transform if name in look.view.looks else "")
    width, height = paint.box_size([title], look.scale)
    x = seen.right - gap - width if right_side else seen.left + gap
    if width + 2 * gap <= seen.width / 2:
        paint.box([(title, paint.INK)], (x, seen.top - gap - height), look.scale)
    legend = look.view.legend(name, look.maximum) if name != NOTHING else None
    if legend is not None:
        _draw_legend(look, legend, seen, right_side)


def _draw_legend(look: _Look, legend: tuple[float, str], seen: Rect, right_side: bool) -> None:
    """Draw a bar of colours from 0 to the configured maximum, with ticks, numbers and the quantity."""
    scale, (maximum, quantity) = look.scale, legend
    gap, line = _GAP_PX * scale, paint.text_size("0", scale)[1]
    wanted = max(_LEGEND_PX * scale, paint.text_size(quantity, scale)[0] + 2 * gap)
    height = 2 * line + _BAR_PX * scale + 2.5 * gap
    if wanted + 2 * gap > seen.width or height + 2 * gap > seen.height / 2:
        return  # the picture is too small to cover it
    x = seen.right - gap - wanted if right_side else seen.left + gap
    ground = Rect(x, seen.bottom + gap, x + wanted, seen.bottom + gap + height)
    paint.fill(ground, paint.GROUND)
    bar = Rect(ground.left + 2 * gap, ground.top - gap - _BAR_PX * scale, ground.right - 2 * gap, ground.top - gap)
    paint.ramp(bar, colormap(np.linspace(0, 1, _RAMP_STOPS), look.colormap))
    for share, text in tick_values(maximum):
        tick = bar.left + share * bar.width
        paint.fill(Rect(tick - 0.5 * scale, bar.bottom - 3 * scale, tick + 0.5 * scale, bar.bottom), paint.INK)
        if share in (0.0, 0.5, 1.0):
            width = paint.text_size(text, scale)[0]
            x = min(max(tick - width / 2, ground.left + 2), ground.right - width - 2)
            paint.write(text, x, bar.bottom - 4 * scale - 0.8 * line, scale)
    width = paint.text_size(quantity, scale)[0]
    paint.write(quantity, ground.left + (ground.right - ground.left - width) / 2, ground.bottom + 0.6 * gap, scale)


def _draw_mark(text: str, short: str, seen: Rect, scale: float, below_title: bool) -> None:
    """Draw a warning below the title, or `short` where there is no room for the `text`."""
    gap = _GAP_PX * scale
    width, height = paint.box_size([text], scale)
    down = gap + (height + gap if below_title else 0.0) + height
    if width + 2 * gap > seen.width:
        text = short
    paint.box([(text, paint.WARNING)], (seen.left + gap, seen.top - down), scale)


def _draw_inspected(context: bpy.types.Context, pixel: InspectedPixel) -> None:
    scale = context.preferences.system.ui_scale
    size = paint.box_size(pixel.lines, scale)
    corner = beside((pixel.x, pixel.y), size, 14 * scale, free_rect(context.area, context.region))
    paint.box([(line, paint.INK) for line in pixel.lines], corner, scale)
