# SPDX-License-Identifier: GPL-3.0-or-later
"""Render geometry: subdivision, modifiers and curves with their render settings."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy


@contextmanager
def render_geometry(depsgraph: bpy.types.Depsgraph) -> Iterator[None]:
    """Evaluate `depsgraph` with render settings within the block; the scene is as before afterwards.

    Only what differs between viewport and render is set, so that nothing is evaluated twice without need. A render's
    own graph has these settings anyway, and nothing may be set while it renders.
    """
    if depsgraph.mode == "RENDER":
        yield
        return
    before: list[tuple[Any, str, Any]] = []
    try:
        for owner, key, value in _render_values(depsgraph.scene.original):
            if getattr(owner, key) != value:
                before.append((owner, key, getattr(owner, key)))
                setattr(owner, key, value)
        if before:
            depsgraph.update()
        yield
    finally:
        for owner, key, value in reversed(before):
            setattr(owner, key, value)
        if before:
            depsgraph.update()


def _render_values(scene: bpy.types.Scene) -> Iterator[tuple[Any, str, Any]]:
    """Viewport properties and the values that renders use instead."""
    if scene.render.use_simplify:
        yield scene.render, "simplify_subdivision", scene.render.simplify_subdivision_render
    for item in bpy.data.objects:
        for modifier in item.modifiers:
            yield modifier, "show_viewport", modifier.show_render
            if modifier.type in ("SUBSURF", "MULTIRES"):
                yield modifier, "levels", modifier.render_levels
    for curve in bpy.data.curves:
        for axis in ("u", "v"):
            if resolution := getattr(curve, f"render_resolution_{axis}"):
                yield curve, f"resolution_{axis}", resolution
    for metaball in bpy.data.metaballs:
        yield metaball, "resolution", metaball.render_resolution
