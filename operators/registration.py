# SPDX-License-Identifier: GPL-3.0-or-later
"""Registration in a fixed order, unregistration in the exact reverse."""

from __future__ import annotations

import atexit
from collections.abc import Iterator, Sequence
from importlib import import_module
from types import ModuleType
from typing import Any

import bpy

from ..patchnet_addon.process.computed import leave_engine_process, use_engine_process
from .jobs import job_operator
from .properties import preferences

# Of each module Blender gets its CLASSES, or all that it declares; the functions in its HANDLERS, by their names in
# `bpy.app.handlers`, and in its MENUS, by the type of menu. Then its register() is called. Its TIMERS end with it.
_NAMES = (
    "scene_access.window_state",
    "properties.preferences",
    "properties.stages",
    "session.scene_session",
    "scene.track",
    "session.staleness",
    "scene_access.overrides",
    "scene_access.temporary",
    "scene_access.window_job",
    "jobs.job_operator",
    "scene_access.unread_file",
    "session.octree_cache",
    "session.world_maps",
    "voxelize_objects",
    "bake_light",
    "precompute_codes",
    "render_preview",
    "refine_with_cycles",
    "run_all",
    "load_octree",
    "estimate",
    "bake_animation",
    "fly_through",
    "show_voxels",
    "export_octree",
    "clear_results",
    "ui.presets_menu",
    "cache",
    "copy_diagnostics",
    "add_demo_scene",
    "ui",
    "overlay.overlay_settings",
    "overlay.drawing",
    "overlay.mouse",
    "overlay.open_pictures",
    "overlay.panel",
    "overlay",
    "render_engine.viewport",
    "render_engine.viewport_mask",
    "render_engine",
    "render_engine.panels",
)
_MODULES = tuple(import_module(f"{__package__}.{name}") for name in _NAMES)
_KINDS = (
    bpy.types.Operator, bpy.types.Macro, bpy.types.Panel, bpy.types.PropertyGroup, bpy.types.AddonPreferences
)  # fmt: skip


def classes_of(module: ModuleType) -> Sequence[type]:
    """Classes of a module for Blender."""
    own = (item for item in vars(module).values() if isinstance(item, type) and item.__module__ == module.__name__)
    found: Sequence[type] = getattr(module, "CLASSES", None) or [item for item in own if issubclass(item, _KINDS)]
    return found


def _handlers_of(module: ModuleType) -> Iterator[tuple[list[Any], Any]]:
    """Blender's lists of handlers, those that this version has, and the module's functions in them."""
    for name, function in getattr(module, "HANDLERS", ()):
        if hasattr(bpy.app.handlers, name):
            yield getattr(bpy.app.handlers, name), function


def register() -> None:
    """Register everything with Blender."""
    for module in _MODULES:
        for item in classes_of(module):
            bpy.utils.register_class(item)
        for handlers, function in _handlers_of(module):
            handlers.append(function)
        for menu, draw in getattr(module, "MENUS", ()):
            getattr(bpy.types, menu).append(draw)
        if hasattr(module, "register"):
            module.register()
    if not bpy.app.module:  # a program that has Blender as a module has no window
        use_engine_process()
    # Blender disables extensions before it exits. As a module it hangs on classes that are still registered.
    if not preferences.IS_EXTENSION:
        atexit.register(unregister)


def unregister() -> None:
    """Unregister everything in reverse order, after the end of a job that works, which needs it."""
    atexit.unregister(unregister)
    job_operator.stop_running_job()
    for module in reversed(_MODULES):
        if hasattr(module, "unregister"):
            module.unregister()
        for timer in getattr(module, "TIMERS", ()):
            if bpy.app.timers.is_registered(timer):
                bpy.app.timers.unregister(timer)
        for menu, draw in getattr(module, "MENUS", ()):
            getattr(bpy.types, menu).remove(draw)
        for handlers, function in _handlers_of(module):
            handlers.remove(function)
        for item in reversed(classes_of(module)):
            bpy.utils.unregister_class(item)
    leave_engine_process()
