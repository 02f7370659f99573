# SPDX-License-Identifier: GPL-3.0-or-later
"""Key of a frame's surface and light, equal for frames of an animation that only differ by their cameras."""

from __future__ import annotations

import bpy

from ..scene.fingerprint import SceneFingerprint, composed, has_films
from ..schema.table import CODES, LIGHT, OCTREE, VISIBLE, result_fields
from ..settings.job_settings import JobSettings
from ..state.block_hashes import MOVES_BY_ITSELF

_STILL = (bpy.types.Camera, bpy.types.Scene)  # their animation changes no surface


def surface_key(depsgraph: bpy.types.Depsgraph, settings: JobSettings) -> str:
    """32 hex digits over settings and all that an octree of the scene depends on at the graph's frame.

    Cameras do not count, nor does the number of the frame unless an image is a film. Raises as `read_scene` does.
    """
    values, scene = settings.flat(), SceneFingerprint(depsgraph)
    scopes = dict.fromkeys((settings.surface.scope, VISIBLE))  # what is not voxelized shadows nevertheless
    parts = [*(scene.surface(scope) for scope in scopes), scene.lights()]
    frame = depsgraph.scene.frame_current_final if has_films() else None
    return composed(*(values[name] for name in result_fields(OCTREE, LIGHT, CODES)), *parts, frame)


def may_change(scene: bpy.types.Scene) -> bool:
    """Return whether anything but a camera has keys or drivers, or moves without: else all frames have one surface."""
    if has_films() or scene.rigidbody_world is not None or any(_moves(item) for item in scene.objects):
        return True
    kinds = (value for name in dir(bpy.data) if _is_collection(value := getattr(bpy.data, name)))
    return any(_is_animated(block) for kind in kinds for block in kind)


def _is_collection(value: object) -> bool:
    return isinstance(value, bpy.types.bpy_prop_collection)


def _moves(item: bpy.types.Object) -> bool:
    return bool(item.particle_systems) or any(modifier.type in MOVES_BY_ITSELF for modifier in item.modifiers)


def _is_animated(block: bpy.types.ID) -> bool:
    if isinstance(block, _STILL) or (isinstance(block, bpy.types.Object) and block.type == "CAMERA"):
        return False
    owners = (block, getattr(block, "node_tree", None), getattr(block, "shape_keys", None))
    found = [data for owner in owners if (data := getattr(owner, "animation_data", None)) is not None]
    return any(data.action is not None or len(data.drivers) > 0 or len(data.nla_tracks) > 0 for data in found)
