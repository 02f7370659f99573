# SPDX-License-Identifier: GPL-3.0-or-later
"""Preferences of the extension, which belong to a user or a computer rather than to a scene."""

from __future__ import annotations

import os
from dataclasses import dataclass, fields

import bpy
from bpy.props import EnumProperty, FloatProperty, StringProperty

from ...patchnet_addon.image.colormaps import COLORMAPS
from ...patchnet_addon.runtime.bounds import KEPT_GIB as KEPT
from ...patchnet_addon.runtime.log import set_up

# "patchnet", or "bl_ext.<repository>.patchnet" in Blender
ROOT_PACKAGE = __package__.removesuffix(".operators.properties")
IS_EXTENSION = ROOT_PACKAGE.startswith("bl_ext.")
OPEN_WINDOW, OPEN_EDITOR, OPEN_NEVER = "WINDOW", "EDITOR", "NEVER"
VIEWPORT_AUTO, VIEWPORT_CARD, VIEWPORT_CPU = "AUTO", "CARD", "CPU"
KEPT_GIB, CARD_GIB = 4.0, 2.0
_LEVELS = ("ERROR", "WARNING", "INFO", "DEBUG")


class PatchNetPreferences(bpy.types.AddonPreferences):
    """Shown under Edit > Preferences > Add-ons."""

    bl_idname = ROOT_PACKAGE

    cache_folder: StringProperty(
        name="Cache Folder",
        description="Folder for compiled kernels, baked light and finished octrees, from the next start of Blender on; "
        "empty uses the extension's own",
        subtype="DIR_PATH",
    )
    kept_gib: FloatProperty(
        name="Octree Cache (GiB)",
        description="Disk limit of finished octrees, which are there again when their file is opened; a higher one "
        "keeps more of them, 0 keeps none",
        default=KEPT_GIB,
        min=KEPT.low,
        max=KEPT.high,
        soft_max=64.0,
        step=100,
        precision=1,
    )
    colormap: EnumProperty(
        name="Color Map",
        description="Colors of the heatmap and the error picture",
        items=[(name, name.capitalize(), "") for name in COLORMAPS],
        default=COLORMAPS[0],
    )
    open_pictures: EnumProperty(
        name="Open Pictures",
        description="Where the heatmap opens when a preview is ready",
        items=[
            (
                OPEN_WINDOW,
                "Editor or Window",
                "An open Image Editor that shows none of your images, else a new window beside the viewport",
            ),
            (OPEN_EDITOR, "Image Editor", "An open Image Editor that shows none of your images, else nowhere"),
            (OPEN_NEVER, "Nowhere", "No picture opens; Image Editors list all of them"),
        ],
        default=OPEN_WINDOW,
    )
    viewport: EnumProperty(
        name="Viewport Device",
        description="Device that draws viewports in shading mode Rendered, with the render engine PatchNet",
        items=[
            (VIEWPORT_AUTO, "Automatic", "The GPU if it is known to work, else the CPU"),
            (VIEWPORT_CARD, "GPU", "The GPU, even if it is untested"),
            (VIEWPORT_CPU, "CPU", "All cores of the CPU; slower, and without live heatmaps"),
        ],
        default=VIEWPORT_AUTO,
    )
    card_gib: FloatProperty(
        name="GPU Memory (GiB)",
        description="Limit of GPU memory for the voxels of a scene; a higher one draws larger octrees on the GPU, the "
        "CPU draws all others",
        default=CARD_GIB,
        min=KEPT.low,
        max=KEPT.high,
        soft_max=16.0,
        step=100,
        precision=1,
    )
    log_level: EnumProperty(
        name="Log Level",
        description="Least severe messages in the terminal; Debug writes most",
        items=[(name, name.capitalize(), "") for name in _LEVELS],
        default="WARNING",
    )

    def draw(self, _context: bpy.types.Context) -> None:
        """Settings, and the buttons of cache and diagnostics."""
        layout = self.layout
        layout.use_property_split = True
        for name in ("colormap", "open_pictures", "viewport", "card_gib"):
            layout.prop(self, name)
        layout.prop(self, "cache_folder", placeholder="The Extension's Own")
        layout.operator("patchnet.clear_cache", icon="TRASH")
        layout.prop(self, "kept_gib")
        layout.prop(self, "log_level")
        layout.operator("patchnet.copy_diagnostics", icon="COPYDOWN")


@dataclass(frozen=True)
class Preferences:
    """Preferences as plain values; the defaults hold where PatchNet is a package and no add-on."""

    cache_folder: str = ""
    colormap: str = COLORMAPS[0]
    log_level: str = "WARNING"
    open_pictures: str = OPEN_WINDOW
    kept_gib: float = KEPT_GIB
    viewport: str = VIEWPORT_AUTO
    card_gib: float = CARD_GIB


def preferences(context: bpy.types.Context) -> Preferences:
    """Preferences of the user."""
    addon = context.preferences.addons.get(ROOT_PACKAGE)
    if addon is None or addon.preferences is None:
        return Preferences()
    values = addon.preferences
    return Preferences(**{field.name: getattr(values, field.name) for field in fields(Preferences)})


def apply_preferences(context: bpy.types.Context) -> None:
    """Set up the process to work: log, and cache folder where it was not known at registration.

    Raises SettingError for a log format that there is not.
    """
    chosen = preferences(context)
    set_up(level=chosen.log_level)
    _name_cache_folder(chosen)


def _name_cache_folder(chosen: Preferences) -> None:
    folder = bpy.path.abspath(chosen.cache_folder) if chosen.cache_folder else ""
    if not folder and IS_EXTENSION and "PATCHNET_CACHE" not in os.environ:
        folder = bpy.utils.extension_path_user(ROOT_PACKAGE, path="cache")
    if folder:
        os.environ.setdefault("PATCHNET_CACHE", folder)


def register() -> None:
    """Name the cache folder."""
    _name_cache_folder(preferences(bpy.context))  # before anything imports kernels, as a render without a window does
