# SPDX-License-Identifier: GPL-3.0-or-later
"""Registration in a fixed order, unregistration in the exact reverse."""

from __future__ import annotations

import atexit

import bpy

from . import (
    bake_animation,
    bake_light,
    clear_results,
    engine,
    export_octree,
    panel,
    precompute_codes,
    preferences,
    properties,
    render_preview,
    results,
    run_all,
    show_voxels,
    voxelize,
)

_BEFORE = (preferences, properties, results)  # have register() and unregister() of their own
_OPERATORS = (
    voxelize,
    bake_light,
    precompute_codes,
    render_preview,
    run_all,
    bake_animation,
    show_voxels,
    export_octree,
    clear_results,
)
_CLASSES = tuple(item for module in (*_OPERATORS, panel) for item in module.CLASSES)


def register() -> None:
    """Make everything known to Blender."""
    for module in _BEFORE:
        module.register()
    for item in _CLASSES:
        bpy.utils.register_class(item)
    engine.register()
    # Blender disables its extensions before it exits. Whatever else is still registered then makes it hang.
    if not preferences.IS_EXTENSION:
        atexit.register(unregister)


def unregister() -> None:
    """Forget everything, last first."""
    atexit.unregister(unregister)
    engine.unregister()
    for item in reversed(_CLASSES):
        bpy.utils.unregister_class(item)
    for module in reversed(_BEFORE):
        module.unregister()
