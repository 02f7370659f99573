# SPDX-License-Identifier: GPL-3.0-or-later
"""Registration in a fixed order, unregistration in the exact reverse."""

from __future__ import annotations

import atexit
from types import ModuleType

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

# Have register() and unregister() of their own.
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
_OPERATORS: tuple[ModuleType, ...] = (
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


def register() -> None:
    """Make everything known to Blender."""
    for module in _BEFORE:
        module.register()
    for item in _CLASSES:
        bpy.utils.register_class(item)
    overlay.register()
    render_engine.register()
    # Blender disables its extensions before it exits. Whatever else is still registered then makes it hang.
    if not preferences.IS_EXTENSION:
        atexit.register(unregister)


def unregister() -> None:
    """Forget everything, last first, once the job that works now has ended: it needs what is forgotten."""
    atexit.unregister(unregister)
    job_operator.stop_running_job()
    render_engine.unregister()
    overlay.unregister()
    for item in reversed(_CLASSES):
        bpy.utils.unregister_class(item)
    for module in reversed(_BEFORE):
        module.unregister()
