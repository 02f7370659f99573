# SPDX-License-Identifier: GPL-3.0-or-later
"""Keys of finished voxels: all that an octree, its light and its codes depend on, by value."""

from __future__ import annotations

import bpy

from ...patchnet_addon.process.computed import computed
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.runtime.source_hash import source_hash
from ..cycles.bake.gloss_passes import with_view
from ..cycles.daylight import has_light
from ..scene.fingerprint import has_films, lights_hash, surface_hash
from ..scene.read import read_scene
from ..scene.render_geometry import render_geometry
from ..schema.values import CODES, LIGHT, OCTREE, VISIBLE
from ..settings.job_settings import JobSettings, result_fields
from ..state.block_hashes import place_of_gloss
from ..state.digest import composed

# Modules that make results; their imports count, too.
_CODE = (
    "operators.animation.animation", "operators.animation.frame_maker",
    "operators.pipeline.run", "operators.voxelize_objects", "operators.bake_light", "operators.precompute_codes",
    "operators.load_octree",
)  # fmt: skip


class _Code:
    """Hash of the code, once it is known."""

    known = ""


def code_hash() -> str:
    """Hash of the code that makes results, so that versions do not mix their results."""
    _Code.known = _Code.known or source_hash(*_CODE)
    return _Code.known


def hashed_code() -> Steps[None]:
    """Have the engine hash the code, which takes a moment; `code_hash` then returns at once."""
    if not _Code.known:
        _Code.known = yield from computed(source_hash, *_CODE, at=Progress(0, 1, "Reading the scene"))


def surface_key(depsgraph: bpy.types.Depsgraph, settings: JobSettings) -> str:
    """32 hex digits over settings and all that an octree of the scene depends on at the graph's frame.

    Cameras do not count, nor does the number of the frame unless an image is a film. Raises as `read_scene` does.
    """
    values = settings.values
    scopes = dict.fromkeys((settings.surface.scope, VISIBLE))  # objects without voxels cast shadows too
    with render_geometry(depsgraph):
        parts = [*(surface_hash(read_scene(depsgraph, scope)) for scope in scopes), lights_hash(depsgraph)]
    frame = depsgraph.scene.frame_current_final if has_films() else None
    return composed(*(getattr(values, name) for name in result_fields(OCTREE, LIGHT, CODES)), *parts, frame)


def voxels_key(depsgraph: bpy.types.Depsgraph, settings: JobSettings, surface: str, cameras: str) -> str:
    """32 hex digits over all that finished voxels depend on, the same in each process and however they are made.

    surface: `surface_key`. cameras: those that levels and light are fitted to, as `cameras_text` has them. Raises
    SceneError as `with_view` does.
    """
    scene, light, daylight, gloss = depsgraph.scene.original, settings.light, None, ""
    if light.is_baked:
        track, named = settings.surface.track, settings.view.cameras
        gloss = place_of_gloss(scene) if with_view(scene, light, named, track=track).from_camera else ""
        daylight = not has_light(depsgraph) if light.daylight is None else light.daylight
    grid = settings.surface.bounds
    return composed(code_hash(), bpy.app.version_string, surface, grid, daylight, gloss, cameras)
