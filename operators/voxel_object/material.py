# SPDX-License-Identifier: GPL-3.0-or-later
"""Material of shown voxels: their colour as it is, without any light of the scene."""

from __future__ import annotations

import bpy

from ..scene_access.blender_version import start_nodes
from ..scene_access.own import OWNER

_NAME = "PatchNet Voxels"
LUMINANCE = "luminance"
COLOR = "voxel_color"  # "color" would be the object's own, white, where it is not there


def voxel_material() -> bpy.types.Material:
    """Material of shown voxels, made once a file; what a user changes in it stays."""
    material = next((item for item in bpy.data.materials if item.get(OWNER) == _NAME), None)
    return material or _new_material()


def _new_material() -> bpy.types.Material:
    """Emission of the voxels' colour, gray where the octree has luminance alone.

    On points and real cubes the attribute is the geometry's, on instances theirs; one that is not there reads 0, so the
    sum is whichever there is.
    """
    material = bpy.data.materials.new(_NAME)
    material[OWNER] = _NAME
    material.cycles.emission_sampling = "NONE"  # nothing else in the scene is lit by it
    tree = start_nodes(material)
    tree.nodes.clear()
    total = tree.nodes.new("ShaderNodeVectorMath")
    for index, kind in enumerate(("GEOMETRY", "INSTANCER")):
        attribute = tree.nodes.new("ShaderNodeAttribute")
        attribute.attribute_name, attribute.attribute_type = COLOR, kind
        attribute.location = (-400, -200 * index)
        tree.links.new(attribute.outputs["Vector"], total.inputs[index])
    emission, output = tree.nodes.new("ShaderNodeEmission"), tree.nodes.new("ShaderNodeOutputMaterial")
    total.location, emission.location, output.location = (-200, 0), (0, 0), (200, 0)
    tree.links.new(total.outputs[0], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    return material
