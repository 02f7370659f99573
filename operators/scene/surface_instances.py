# SPDX-License-Identifier: GPL-3.0-or-later
"""Placed objects of a scene that renders show, to voxelize those that have a surface."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from ..scene_access.own import is_own
from ..schema.table import VISIBLE


def shown_instances(
    depsgraph: bpy.types.Depsgraph, scope: str, chosen: frozenset[int] | None = None
) -> Iterator[bpy.types.DepsgraphObjectInstance]:
    """Instances that are visible to the camera, in the dependency graph's order.

    SELECTED: selected objects, or those `chosen` by session_uid, and their instances. VISIBLE: all visible objects that
    render. Each is valid until the next step of the iteration, as in Blender. Call within `render_geometry`.
    """
    layer = depsgraph.view_layer.original if hasattr(depsgraph.view_layer, "original") else depsgraph.view_layer
    rendered = _rendered_objects(layer)
    for instance in depsgraph.object_instances:
        if not instance.show_particles and not shows_itself(instance):
            continue
        owner = (instance.parent if instance.is_instance else instance.object).original
        if owner.name_full not in rendered or (instance.is_instance and _hidden_instance(instance)):
            continue
        taken = owner.select_get(view_layer=layer) if chosen is None else owner.session_uid in chosen
        if scope == VISIBLE or taken:
            yield instance


def shows_itself(instance: bpy.types.DepsgraphObjectInstance) -> bool:
    """Return whether the object itself is shown, and not only its hair or its instances."""
    if not instance.show_self or instance.is_instance:
        return bool(instance.show_self)
    parent = instance.object.parent
    return parent is None or parent.instance_type not in ("VERTS", "FACES")


def shows_mesh(instance: bpy.types.DepsgraphObjectInstance) -> bool:
    """Return whether a mesh is shown.

    Curves, text, surfaces and metaballs come a second time, evaluated, as an instance of type MESH.
    """
    return instance.object.type == "MESH" and shows_itself(instance)


def _rendered_objects(layer: bpy.types.ViewLayer) -> frozenset[str]:
    """Names of the layer's objects that render and that the camera can see."""
    names: set[str] = set()
    unseen: set[str] = set()  # in any collection with Holdout or Indirect Only
    stack = [layer.layer_collection]
    while stack:
        item = stack.pop()
        if item.collection.hide_render:
            continue
        stack.extend(item.children)
        if item.exclude:
            continue
        found = {each.name_full for each in item.collection.objects if _renders(each)}
        (unseen if item.holdout or item.indirect_only else names).update(found)
    return frozenset(names - unseen)


def _renders(item: bpy.types.Object) -> bool:
    """Test for rendered objects; objects of PatchNet are no surface, even if they render."""
    return not (is_own(item) or item.hide_render or item.is_holdout) and _is_seen(item)


def _is_seen(item: bpy.types.Object) -> bool:
    """Test for objects that the camera sees, directly or instanced, and no shadow catchers."""
    return item.visible_camera and not item.is_shadow_catcher


def _hidden_instance(instance: bpy.types.DepsgraphObjectInstance) -> bool:
    """Test whether the instanced object is hidden from the camera, or disabled for renders.

    Geometry nodes instance disabled objects anyway, in renders too.
    """
    item = instance.instance_object.original
    return not _is_seen(item) or (instance.parent.instance_type != "NONE" and item.hide_render)
