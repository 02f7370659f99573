# SPDX-License-Identifier: GPL-3.0-or-later
"""What a scene is, in short, so that after an undo it is known whether results fit it again.

Blender then reports everything as changed. Bounded: larger scenes have no state, and count as changed.
"""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from .bake.digest import Digest, names
from .own import is_own

MOST_VERTICES = 2_000_000
MOST_OBJECTS = 5_000
_SKIPPED_OF_DATA = names("materials texspace_location texspace_size is_editmode")
_POSITION = "position"


@dataclass(frozen=True)
class SceneState:
    """Hashes of what is voxelized, and of what it is lit by and made of."""

    surface: str
    light: str


def scene_state(scene: bpy.types.Scene) -> SceneState | None:
    """The state of a scene's objects, without those that show results; None for a scene that is too large."""
    items = [item for item in scene.objects if not is_own(item)]
    meshes = {item.data for item in items if isinstance(item.data, bpy.types.Mesh)}
    if len(items) > MOST_OBJECTS or sum(len(mesh.vertices) for mesh in meshes) > MOST_VERTICES:
        return None
    surface, light = Digest(), Digest()
    met: set[bpy.types.ID] = set()
    for item in items:
        if item.type == "CAMERA":
            continue
        digest = light if item.type in ("LIGHT", "LIGHT_PROBE") else surface
        # The world's matrix is not known right after an undo.
        rows = tuple(tuple(row) for matrix in (item.matrix_basis, item.matrix_parent_inverse) for row in matrix)
        digest.text(item.name_full, rows, item.parent and item.parent.name_full, item.hide_render)
        digest.text(item.data and item.data.name_full, item.instance_type)
        for modifier in item.modifiers:
            digest.struct(modifier, depth=1)
        if item.data is not None and item.data not in met:
            met.add(item.data)
            _add_data(item.data, surface, light)
        for slot in item.material_slots:
            light.block(slot.material)
    light.block(scene.world)
    return SceneState(surface.hexdigest(), light.hexdigest())


def _add_data(data: bpy.types.ID, surface: Digest, light: Digest) -> None:
    """Geometry to the surface, all else that a bake shows to the light."""
    if not isinstance(data, bpy.types.Mesh):
        (light if isinstance(data, bpy.types.Light) else surface).struct(data, _SKIPPED_OF_DATA, depth=2)
        light.block(getattr(data, "node_tree", None))
        return
    if data.is_editmode:
        surface.text("edited", id(data))
    points = np.empty(len(data.vertices) * 3, np.float32)
    data.vertices.foreach_get("co", points)
    loops = np.empty(len(data.loops), np.int32)
    data.loops.foreach_get("vertex_index", loops)
    surface.array(_POSITION, points)
    surface.array("loops", loops)
    faces = np.empty(len(data.polygons), np.int32)
    data.polygons.foreach_get("material_index", faces)
    light.array("materials", faces)
    for layer in data.uv_layers:
        values = np.empty(len(layer.uv) * 2, np.float32)  # none while the mesh is edited
        if len(values):
            layer.uv.foreach_get("vector", values)
        light.array(layer.name, values)
