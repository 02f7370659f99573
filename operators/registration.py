# SPDX-License-Identifier: GPL-3.0-or-later
"""Registration in a fixed order, unregistration in the exact reverse."""

from __future__ import annotations

import atexit
from collections.abc import Iterator, Sequence
from types import ModuleType
from typing import Any

import bpy

from . import (
    add_demo_scene,
    bake_animation,
    bake_light,
    cache,
    clear_results,
    copy_diagnostics,
    estimate,
    export_octree,
    load_octree,
    overlay,
    precompute_codes,
    refine_with_cycles,
    render_engine,
    render_preview,
    run_all,
    show_voxels,
    ui,
    voxelize_objects,
)
from .jobs import job_operator
from .overlay import drawing, mouse, open_pictures, overlay_settings
from .overlay import panel as overlay_panel
from .properties import preferences, stages
from .render_engine import panels
from .scene_access import overrides, temporary, unread_file, window_job
from .session import octree_cache, scene_session, staleness, world_maps
from .ui import presets_menu

# Of each module Blender gets its CLASSES, or all that it declares; the functions in its HANDLERS, by their names in
# `bpy.app.handlers`, and in its MENUS, by the type of menu. Then its register() is called. Its TIMERS end with it.
_MODULES = (
    preferences,
    stages,
    scene_session,
    staleness,
    overrides,
    temporary,
    window_job,
    job_operator,
    unread_file,
    octree_cache,
    world_maps,
    voxelize_objects,
    bake_light,
    precompute_codes,
    render_preview,
    refine_with_cycles,
    run_all,
    load_octree,
    estimate,
    bake_animation,
    show_voxels,
    export_octree,
    clear_results,
    presets_menu,
    cache,
    copy_diagnostics,
    add_demo_scene,
    ui,
    overlay_settings,
    drawing,
    mouse,
    open_pictures,
    overlay_panel,
    overlay,
    render_engine,
    panels,
)
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
