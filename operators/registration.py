# SPDX-License-Identifier: GPL-3.0-or-later
"""Registration in a fixed order, unregistration in the exact reverse."""

from __future__ import annotations

import atexit
from collections.abc import Iterable, Iterator, Sequence
from types import ModuleType
from typing import Any

import bpy

from . import (
    add_demo_scene,
    bake_animation,
    bake_light,
    cache,
    clear_results,
    compare,
    copy_diagnostics,
    estimate,
    export_octree,
    load_octree,
    overlay,
    precompute_codes,
    properties,
    refine_with_cycles,
    render_engine,
    render_preview,
    run_all,
    show_voxels,
    ui,
    voxelize_objects,
)
from .jobs import job_operator
from .properties import preferences
from .scene_access import bake_operator, overrides, temporary, unread_file
from .session import octree_cache, scene_session, staleness, world_maps
from .ui import presets_menu

# Have HANDLERS, names and functions for `bpy.app.handlers`, or register() or unregister(), or all of these.
_BEFORE = (
    preferences,
    properties,
    scene_session,
    staleness,
    overrides,
    temporary,
    bake_operator,
    job_operator,
    unread_file,
    octree_cache,
    world_maps,
    presets_menu,
    load_octree,
    copy_diagnostics,
    add_demo_scene,
)
_AFTER = (overlay, render_engine)
_OPERATORS = (
    voxelize_objects,
    bake_light,
    precompute_codes,
    render_preview,
    compare,
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
)


def _operators_of(module: ModuleType) -> list[type]:
    """Operators that a module declares."""
    kinds = [item for item in vars(module).values() if isinstance(item, type) and item.__module__ == module.__name__]
    return [item for item in kinds if issubclass(item, bpy.types.Operator)]


_CLASSES = (*(item for module in _OPERATORS for item in _operators_of(module)), *ui.CLASSES)


def _handlers_of(module: ModuleType) -> Iterator[tuple[list[Any], Any]]:
    """Blender's lists of handlers, those that this version has, and the module's functions in them."""
    for name, function in getattr(module, "HANDLERS", ()):
        if hasattr(bpy.app.handlers, name):
            yield getattr(bpy.app.handlers, name), function


def _register(modules: Iterable[ModuleType]) -> None:
    for module in modules:
        for handlers, function in _handlers_of(module):
            handlers.append(function)
        if hasattr(module, "register"):
            module.register()


def _unregister(modules: Sequence[ModuleType]) -> None:
    for module in reversed(modules):
        for handlers, function in _handlers_of(module):
            handlers.remove(function)
        if hasattr(module, "unregister"):
            module.unregister()


def register() -> None:
    """Register everything with Blender."""
    _register(_BEFORE)
    for item in _CLASSES:
        bpy.utils.register_class(item)
    _register(_AFTER)
    # Blender disables extensions before it exits. As a module it hangs on classes that are still registered.
    if not preferences.IS_EXTENSION:
        atexit.register(unregister)


def unregister() -> None:
    """Unregister everything in reverse order, after the end of a job that works, which needs it."""
    atexit.unregister(unregister)
    job_operator.stop_running_job()
    _unregister(_AFTER)
    for item in reversed(_CLASSES):
        bpy.utils.unregister_class(item)
    _unregister(_BEFORE)
