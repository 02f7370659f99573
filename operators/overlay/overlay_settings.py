# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of the overlay, kept in the window manager: changes make no undo step and are not saved. Its state."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol
from weakref import WeakValueDictionary

import bpy
from bpy.props import BoolProperty, EnumProperty, PointerProperty

from ..properties.stages import share
from ..scene_access.window_state import Part
from ..session.shown_view import HEATMAP, PREVIEW, TITLES
from .framed import EDITORS
from .paint import textures

NOTHING = "NONE"
_DESCRIPTIONS = (
    "Priority of each pixel, up to the heatmap's configured maximum",
    "One sample per pixel",
    "The picture as predicted by the network",
    "The picture after the budget is spent",
    "32 x 32 samples in every pixel",
    "The picture with the pixels that Refine with Cycles rendered",
    "Difference between the preview and the reference",
    "Difference between the predicted picture and the reference",
    "Difference between the refined picture and the reference",
)
_ITEMS = [(*named, text) for named, text in zip(TITLES.items(), _DESCRIPTIONS, strict=True)]

COMBINED, PRIORITY, COVERAGE, PREDICTED_LIVE, LEVEL = "COMBINED", "PRIORITY", "COVERAGE", "PREDICTED", "LEVEL"
_LIVE = [
    (COMBINED, "Combined", "The picture"),
    (
        PRIORITY,
        "Priority",
        "Expected luminance error of each pixel by PatchNet Plus, no ray; with PatchNet (paper), the paper's score",
    ),
    (COVERAGE, "Coverage", "Covered share of each pixel as predicted by the network"),
    (PREDICTED_LIVE, "Predicted", "Luminance of each pixel as predicted by the network"),
    (LEVEL, "Level", "Level of the octree that each pixel shows"),
]


@dataclass(frozen=True)
class InspectedPixel:
    """Pixel under the mouse: address of its region, position of the mouse there, and lines of text about it."""

    region: int
    x: float
    y: float
    lines: list[str]


class LiveHeatmap(Protocol):
    """Heatmap of a viewport in shading mode Rendered. shown: texture, None before there is one."""

    shown: Any

    def describe_pixel(self, column: int, row: int) -> list[str]:
        """Lines about a pixel of the region."""


@dataclass(eq=False)
class OverlayState:
    """State of the overlay.

    problem: why it is switched off, for the panel. inspected: by the address of the window in which pixels are
    inspected. heatmaps: by the address of their region. to_open: names of images that windows of their own will show.
    handles: draw handlers with their types of space.
    """

    problem: str = ""
    inspected: dict[int, InspectedPixel | None] = field(default_factory=dict)
    heatmaps: WeakValueDictionary[int, LiveHeatmap] = field(default_factory=WeakValueDictionary)
    to_open: list[str] = field(default_factory=list)
    handles: list[tuple[Any, Any]] = field(default_factory=list)


overlay_state = Part("overlay", OverlayState)


def refresh(context: bpy.types.Context) -> None:
    """Redraw viewports and Image Editors, also after an error; free the textures if the overlay is off."""
    overlay_state().problem = ""
    values = overlay_settings(context)
    if not (values.show_viewport or values.show_editor):
        textures().free()
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in EDITORS:
                area.tag_redraw()


def _changed(_values: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    refresh(context)


def _switch(name: str, description: str, default: bool = False) -> Any:
    return BoolProperty(name=name, description=description, default=default, update=_changed)


def _picture(name: str, description: str, default: str, *more: tuple[str, str, str]) -> Any:
    """Property that chooses one of the pictures of a view, or one of `more` items."""
    return EnumProperty(name=name, description=description, items=[*_ITEMS, *more], default=default, update=_changed)


class PatchNetOverlaySettings(bpy.types.PropertyGroup):
    """Settings of the overlay on camera views and images."""

    show_viewport: _switch("Overlay", "Lay the picture over the camera's view")
    show_editor: _switch("Overlay", "Lay the picture over PatchNet's images and over the Render Result")
    picture: _picture("Picture", "Picture to show", HEATMAP)
    opacity: share("Opacity", "Opacity of the picture over the viewport or the image", 1.0, update=_changed)
    use_wipe: _switch("Wipe", "Show another picture to the right of a line")
    wipe: share("Position", "Line between the pictures, from the left to the right side", 0.5, update=_changed)
    other: _picture(
        "Other Side",
        "Picture to the right of the line",
        PREVIEW,
        (NOTHING, "Nothing", "The viewport or the image itself"),
    )
    live: EnumProperty(
        name="Live",
        description="Pass that viewports in shading mode Rendered show, also while the view moves",
        items=_LIVE,
        default=COMBINED,
        update=_changed,
    )
    legend: _switch("Legend", "Titles, and bars with numbers and units", default=True)


def overlay_settings(context: bpy.types.Context) -> bpy.types.PropertyGroup:
    """Settings of the overlay in this window."""
    return context.window_manager.patchnet_overlay


def register() -> None:
    """Register the settings."""
    bpy.types.WindowManager.patchnet_overlay = PointerProperty(type=PatchNetOverlaySettings, options={"SKIP_SAVE"})


def unregister() -> None:
    """Unregister the settings."""
    del bpy.types.WindowManager.patchnet_overlay
