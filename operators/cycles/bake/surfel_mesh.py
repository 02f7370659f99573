# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles of surfels as a Blender mesh."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np

from ....patchnet_addon.light.surfel_calls import CallMesh
from ...scene.layer_names import own_name
from ...scene_access.polygons import add_polygons

TEXEL_LAYER = "PatchNet Texels"
SURFACE_LAYER = "PatchNet Surface"


def fill_mesh(mesh: bpy.types.Mesh, part: CallMesh, materials: Sequence[bpy.types.Material]) -> None:
    """Fill an empty mesh with triangles. materials: those that they use."""
    add_polygons(mesh, part.corners_world)
    for material in materials:
        mesh.materials.append(material)
    mesh.attributes.new("material_index", "INT", "FACE").data.foreach_set("value", part.materials)
    mesh.update(calc_edges=True)
    _add_layer(mesh, SURFACE_LAYER, part.uvs)
    mesh.uv_layers[SURFACE_LAYER].active_render = True
    _add_layer(mesh, TEXEL_LAYER, part.texel_uvs)
    for name, values in part.layers.items():
        _add_layer(mesh, own_name(name), values)
    normals = mesh.attributes.new("custom_normal", "FLOAT_VECTOR", "CORNER")
    normals.data.foreach_set("vector", part.normals_world.ravel())


def _add_layer(mesh: bpy.types.Mesh, name: str, values: np.ndarray) -> None:
    """Add a UV map or attribute of values (N, 3, C). `uv_layers.new` is limited to eight maps."""
    kind, key = {
        1: ("FLOAT", "value"), 2: ("FLOAT2", "vector"), 3: ("FLOAT_VECTOR", "vector"), 4: ("FLOAT_COLOR", "color")
    }[values.shape[-1]]  # fmt: skip
    attribute = mesh.attributes.new(name, kind, "CORNER")
    attribute.data.foreach_set(key, values.ravel())
