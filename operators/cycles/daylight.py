# SPDX-License-Identifier: GPL-3.0-or-later
"""Sun and sky that light a scene without light in bakes and renders."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import chain

import bpy
from mathutils import Euler

from ..scene.render_geometry import rendered_collections
from ..scene_access.blender_version import start_nodes, tree_in_use
from ..scene_access.overrides import changed
from ..scene_access.own import check_own_scene, is_own
from ..scene_access.temporary import temporary

SUN_STRENGTH = 4.0  # W/m2
SUN_ANGLE = 0.009  # radians, as from the earth
SUN_ROTATION = (0.42, 0.16, 0.6)  # radians: high enough to reach the floor of a courtyard
SKY_COLOR = (0.55, 0.7, 1.0)
SKY_STRENGTH = 0.8
# Colour and strength inputs of emitting nodes.
EMISSION_INPUTS = {"EMISSION": ("Color", "Strength"), "BSDF_PRINCIPLED": ("Emission Color", "Emission Strength")}


def has_light(depsgraph: bpy.types.Depsgraph) -> bool:
    """Return whether the evaluated scene has light: a lamp, the world, or an emitting material.

    Viewports ask this while they draw, so that what only renders show is looked up without being evaluated.
    """
    if _world_shines(depsgraph.scene.world):
        return True
    materials: set[bpy.types.Material] = set()
    hidden = () if depsgraph.mode == "RENDER" else _hidden(depsgraph.view_layer)
    for item in chain((each.object for each in depsgraph.object_instances), hidden):
        if item.type == "LIGHT" and item.data.energy > 0 and max(item.data.color) > 0:
            return True
        materials.update(slot.material for slot in item.material_slots if slot.material)
    return any(emits(material) for material in materials if not is_own(material))


def _hidden(layer: bpy.types.ViewLayer) -> Iterator[bpy.types.Object]:
    """Objects that renders show and viewports hide, and those of instanced collections, in which these may hide."""
    for each in rendered_collections(layer):
        for item in each.collection.objects:
            if not (item.hide_render or item.visible_get(view_layer=layer)):
                yield item
            if item.instance_collection is not None and not item.hide_render:
                yield from _rendered_in(item.instance_collection)


def _rendered_in(collection: bpy.types.Collection) -> Iterator[bpy.types.Object]:
    if not collection.hide_render:
        yield from (item for item in collection.objects if not item.hide_render)
        for child in collection.children:
            yield from _rendered_in(child)


def _world_shines(world: bpy.types.World | None) -> bool:
    if world is None:
        return False
    tree = tree_in_use(world)
    if tree is None:
        return max(world.color) > 0
    return any(
        node.type == "BACKGROUND" and _bright(node.inputs["Color"]) and _bright(node.inputs["Strength"])
        for node in tree.nodes
        if any(output.is_linked for output in node.outputs)
    )


def emits(material: bpy.types.Material) -> bool:
    """Return whether a material emits light."""
    tree = tree_in_use(material)
    if tree is None:
        return False
    return any(
        all(_bright(node.inputs[name]) for name in EMISSION_INPUTS[node.type])
        for node in tree.nodes
        if node.type in EMISSION_INPUTS and node.outputs[0].is_linked
    )


def _bright(socket: bpy.types.NodeSocket) -> bool:
    """Return whether a colour or strength is not black; linked ones count as bright."""
    value = socket.default_value
    return socket.is_linked or (value > 0 if isinstance(value, float) else max(value[:3]) > 0)


@contextmanager
def daylight(scene: bpy.types.Scene) -> Iterator[None]:
    """Add sun and sky to `scene` within the block.

    Raises SceneError as `check_own_scene`.
    """
    check_own_scene(scene)
    with (
        temporary(bpy.data.lights.new("PatchNet Sun", "SUN")) as lamp,
        temporary(bpy.data.objects.new("PatchNet Sun", lamp)) as sun,
        temporary(bpy.data.worlds.new("PatchNet Sky")) as sky,
    ):
        lamp.energy, lamp.angle = SUN_STRENGTH, SUN_ANGLE
        sun.rotation_euler = Euler(SUN_ROTATION)
        scene.collection.objects.link(sun)
        tree = start_nodes(sky)
        tree.nodes.clear()
        background = tree.nodes.new("ShaderNodeBackground")
        background.inputs["Color"].default_value = (*SKY_COLOR, 1.0)
        background.inputs["Strength"].default_value = SKY_STRENGTH
        tree.links.new(background.outputs[0], tree.nodes.new("ShaderNodeOutputWorld").inputs["Surface"])
        with changed(scene, world=sky):
            yield
