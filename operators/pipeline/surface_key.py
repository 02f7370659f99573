# SPDX-License-Identifier: GPL-3.0-or-later
"""Key of all that an octree of a scene depends on, from evaluated data: frames of equal keys share their voxels."""

from __future__ import annotations

import bpy

from ..scene.fingerprint import has_films, lights_hash, surface_hash
from ..scene.read import read_scene
from ..schema.table import CODES, LIGHT, OCTREE, VISIBLE, result_fields
from ..settings.job_settings import JobSettings
from ..state.digest import composed


def surface_key(depsgraph: bpy.types.Depsgraph, settings: JobSettings) -> str:
    """32 hex digits over settings and all that an octree of the scene depends on at the graph's frame.

    Cameras do not count, nor does the number of the frame unless an image is a film. Raises as `read_scene` does.
    """
    values = settings.flat()
    scopes = dict.fromkeys((settings.surface.scope, VISIBLE))  # objects without voxels cast shadows too
    parts = [*(surface_hash(read_scene(depsgraph, scope)) for scope in scopes), lights_hash(depsgraph)]
    frame = depsgraph.scene.frame_current_final if has_films() else None
    return composed(*(values[name] for name in result_fields(OCTREE, LIGHT, CODES)), *parts, frame)
