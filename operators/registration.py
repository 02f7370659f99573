# SPDX-License-Identifier: GPL-3.0-or-later
"""Registration in a fixed order, unregistration in the exact reverse."""

from __future__ import annotations

import atexit

import bpy

from . import (
    add_demo_scene,
    bake_animation,
    bake_light,
    check_python,
    clear_results,
    compare,
    copy_diagnostics,
    engine,
    estimate,
    export_octree,
    job_operator,
    kept_results,
    load_octree,
    overlay,
    overrides,
    panels,
    precompute_codes,
    preferences,
    presets_menu,
    properties,
    refine_with_cycles,
    render_preview,
    results,
    run_all,
    show_voxels,
    staleness,
    unread_file,
    voxelize,
)
from .cache import clear as clear_cache
from .cache import measure as measure_cache

# Have register() and unregister() of their own.
_BEFORE = (
    preferences,
    properties,
    results,
    staleness,
    overrides,
    job_operator,
    unread_file,
    kept_results,
    presets_menu,
    load_octree,
    copy_diagnostics,
    add_demo_scene,
)
_OPERATORS = (
    voxelize,
    bake_light,
    precompute_codes,
    render_preview,
    compare,
    refine_with_cycles,
    run_all,
    estimate,
    bake_animation,
    show_voxels,
    export_octree,
    clear_results,
    presets_menu,
    measure_cache,
    clear_cache,
    check_python,
    copy_diagnostics,
)
_CLASSES = tuple(item for module in (*_OPERATORS, panels) for item in module.CLASSES)


def register() -> None:
    """Make everything known to Blender."""
    for module in _BEFORE:
        module.register()
    for item in _CLASSES:
        bpy.utils.register_class(item)
    overlay.register()
    engine.register()
    # Blender disables its extensions before it exits. Whatever else is still registered then makes it hang.
    if not preferences.IS_EXTENSION:
        atexit.register(unregister)


def unregister() -> None:
    """Forget everything, last first."""
    atexit.unregister(unregister)
    engine.unregister()
    overlay.unregister()
    for item in reversed(_CLASSES):
        bpy.utils.unregister_class(item)
    for module in reversed(_BEFORE):
        module.unregister()
