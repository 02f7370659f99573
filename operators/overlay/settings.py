# SPDX-License-Identifier: GPL-3.0-or-later
"""How the overlay looks. Settings of the window and not of the scene: no undo step, and nothing of a file changes."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, PointerProperty

from .shown_view import HEATMAP, PREVIEW, TITLES

NOTHING = "NONE"
_ITEMS = [
    (name, title, description)
    for (name, title), description in zip(
        TITLES.items(),
        (
            "Priority of each pixel, up to the heatmap's configured maximum",
            "One sample a pixel",
            "The picture after the budget is spent",
            "32 x 32 samples in every pixel",
            "How far the preview is from the reference",
            "How far the refined picture is from the reference",
        ),
        strict=True,
    )
]


def _changed(_values: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    from . import handlers

    handlers.refresh(context)


class PatchNetOverlaySettings(bpy.types.PropertyGroup):
    """What lies over cameras' views and images."""

    show_viewport: BoolProperty(
        name="In Viewport", description="Lay the picture over the camera's view", default=False, update=_changed
    )
    show_editor: BoolProperty(
        name="In Image Editor",
        description="Lay the picture over PatchNet's images and over the Render Result",
        default=False,
        update=_changed,
    )
    picture: EnumProperty(name="Picture", description="What is shown", items=_ITEMS, default=HEATMAP, update=_changed)
    opacity: FloatProperty(
        name="Opacity",
        description="How much the picture hides what is below",
        default=1.0,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        update=_changed,
    )
    use_wipe: BoolProperty(
        name="Wipe",
        description="Show another picture to the right of a line",
        default=False,
        update=_changed,
    )
    wipe: FloatProperty(
        name="Position",
        description="Where the line is, from the left to the right side of the picture",
        default=0.5,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        update=_changed,
    )
    other: EnumProperty(
        name="Other Side",
        description="What is shown to the right of the line",
        items=[*_ITEMS, (NOTHING, "Nothing", "The viewport or the image itself")],
        default=PREVIEW,
        update=_changed,
    )
    legend: BoolProperty(
        name="Legend", description="Titles, and bars with numbers and units", default=True, update=_changed
    )


def overlay_settings(context: bpy.types.Context) -> bpy.types.PropertyGroup:
    """The settings."""
    return context.window_manager.patchnet_overlay


def register() -> None:
    """Make the settings known."""
    bpy.utils.register_class(PatchNetOverlaySettings)
    bpy.types.WindowManager.patchnet_overlay = PointerProperty(type=PatchNetOverlaySettings, options={"SKIP_SAVE"})


def unregister() -> None:
    """Forget them."""
    del bpy.types.WindowManager.patchnet_overlay
    bpy.utils.unregister_class(PatchNetOverlaySettings)
