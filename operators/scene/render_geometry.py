# SPDX-License-Identifier: GPL-3.0-or-later
"""Render geometry: what renders show, and modifiers, curves, particles and collections with their render settings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from typing import Any

import bpy

from ..scene_access.frames import fcurves, kept_values
from ..scene_access.own import is_own
from ..schema.values import VISIBLE

_WITHOUT_SURFACE = ("LIGHT", "LIGHT_PROBE", "CAMERA")
_OF_VIEWPORTS = ("hide_viewport", ".show_viewport", ".levels", ".viewport_resolution")  # of objects, of modifiers


def hide_from_renders(texts: Sequence[str]) -> list[str]:
    """Hide objects whose own or an ancestor's name contains one of `texts` (lower case); returns those of no object."""
    unused = set(texts)
    for item in bpy.data.objects:
        ancestor = item
        while ancestor is not None and not (found := [text for text in texts if text in ancestor.name.lower()]):
            ancestor = ancestor.parent
        if ancestor is not None:
            item.hide_render = True
            unused.difference_update(found)
    return sorted(unused)


@contextmanager
def render_geometry(depsgraph: bpy.types.Depsgraph) -> Iterator[None]:
    """Evaluate `depsgraph` with render settings within the block; the scene is as before afterwards.

    Only values that differ between viewport and render are set, which avoids needless evaluation. A render's own
    depsgraph has these settings already, and data must not change while it renders.
    """
    if depsgraph.mode == "RENDER":
        yield
        return
    wanted = _render_values(depsgraph.scene.original, depsgraph.view_layer)
    changes = [(owner, key, before, value) for owner, key, value in wanted if (before := getattr(owner, key)) != value]
    with kept_values() if any(key == "mute" for _, key, _, _ in changes) else nullcontext():
        try:
            for owner, key, _, value in changes:
                setattr(owner, key, value)
            if changes:
                depsgraph.update()
            yield
        finally:
            for owner, key, before, _ in reversed(changes):
                setattr(owner, key, before)
            if changes:
                depsgraph.update()


class _Eye:
    """Eye icon of an object in a view layer."""

    def __init__(self, item: bpy.types.Object, layer: bpy.types.ViewLayer) -> None:
        self._item, self._layer = item, layer

    @property
    def hidden(self) -> bool:
        """Whether the object is hidden there."""
        return self._item.hide_get(view_layer=self._layer)

    @hidden.setter
    def hidden(self, value: bool) -> None:
        self._item.hide_set(value, view_layer=self._layer)


def _render_values(scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> Iterator[tuple[Any, str, Any]]:
    """Viewport properties and the values that renders use instead."""
    yield from _shown_in_renders(scene, layer)
    if scene.render.use_simplify:
        yield scene.render, "simplify_subdivision", scene.render.simplify_subdivision_render
        yield scene.render, "simplify_child_particles", scene.render.simplify_child_particles_render
    for item in bpy.data.objects:
        yield item, "show_instancer_for_viewport", item.show_instancer_for_render
        for curve in _overwriting(item):
            yield curve, "mute", True
        for modifier in item.modifiers:
            yield modifier, "show_viewport", modifier.show_render
            if modifier.type in ("SUBSURF", "MULTIRES"):
                yield modifier, "levels", modifier.render_levels
            if modifier.type == "OCEAN":
                yield modifier, "viewport_resolution", modifier.resolution
    for particles in bpy.data.particles:
        yield particles, "display_percentage", 100
        yield particles, "display_method", "RENDER"
        if particles.type == "HAIR":
            yield particles, "display_step", particles.render_step
        if particles.child_type != "NONE":
            yield particles, "child_percent", particles.rendered_child_count
    for curve in bpy.data.curves:
        for axis in ("u", "v"):
            if resolution := getattr(curve, f"render_resolution_{axis}"):
                yield curve, f"resolution_{axis}", resolution
    for metaball in bpy.data.metaballs:
        yield metaball, "resolution", metaball.render_resolution


def _shown_in_renders(scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> Iterator[tuple[Any, str, Any]]:
    """Visibility in viewports of what renders show, and of collections that they hide."""
    for each in rendered_collections(layer):
        for item in each.collection.objects:
            if not item.hide_render:
                yield _Eye(item, layer), "hidden", False
    for item in bpy.data.objects:  # others may be instanced
        if not item.hide_render:
            yield item, "hide_viewport", False
    apart = _apart(scene)
    for collection in bpy.data.collections:
        if not collection.hide_render or collection in apart:
            yield collection, "hide_viewport", collection.hide_render


def _overwriting(item: bpy.types.Object) -> list[bpy.types.FCurve]:
    """Drivers of an object that would overwrite the values, and keyframes, which muting a driver evaluates again."""
    data = item.animation_data
    drivers = [driver for driver in data.drivers if driver.data_path.endswith(_OF_VIEWPORTS)] if data else []
    keyed = fcurves(data) if drivers else ()
    return [*(curve for curve in keyed if curve.data_path.endswith(_OF_VIEWPORTS)), *drivers]


def _apart(scene: bpy.types.Scene) -> set[bpy.types.Collection]:
    """Collections in no view layer of a scene, which objects may still instance.

    The render visibility of the others is known, and hiding one would lose the selection of its objects.
    """
    shown = set()
    stack = [layer.layer_collection for layer in scene.view_layers]
    while stack:
        item = stack.pop()
        stack.extend(item.children)
        if not item.exclude:
            shown.add(item.collection)
    return set(bpy.data.collections) - shown


def shown_instances(
    depsgraph: bpy.types.Depsgraph, scope: str, chosen: frozenset[int] | None = None
) -> Iterator[bpy.types.DepsgraphObjectInstance]:
    """Instances that are visible to the camera, in the dependency graph's order.

    SELECTED: selected objects, or those `chosen` by session_uid, and their instances. VISIBLE: all objects that
    render. Each is valid until the next step of the iteration, as in Blender. Call within `render_geometry`.
    """
    layer = depsgraph.view_layer
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


def rendered_collections(layer: bpy.types.ViewLayer) -> Iterator[bpy.types.LayerCollection]:
    """Collections of a view layer that render, whatever viewports hide."""
    stack = [layer.layer_collection]
    while stack:
        item = stack.pop()
        if item.collection.hide_render:
            continue
        stack.extend(item.children)
        if not item.exclude:
            yield item


def _rendered_objects(layer: bpy.types.ViewLayer) -> frozenset[str]:
    """Names of the layer's objects that render and that the camera can see; objects of PatchNet are no surface."""
    names: set[str] = set()
    unseen: set[str] = set()  # in any collection with Holdout or Indirect Only
    for item in rendered_collections(layer):
        found = {
            each.name_full
            for each in item.collection.objects
            if not (is_own(each) or each.hide_render or each.is_holdout) and _is_seen(each)
        }
        (unseen if item.holdout or item.indirect_only else names).update(found)
    return frozenset(names - unseen)


def cut_out_objects(layer: bpy.types.ViewLayer) -> list[str]:
    """Names of rendered objects that cut holes into pictures, or show only the shadows on them."""
    return sorted(
        each.name
        for item in rendered_collections(layer)
        for each in item.collection.objects
        if not each.hide_render
        and each.type not in _WITHOUT_SURFACE
        and (item.holdout or each.is_holdout or each.is_shadow_catcher)
    )


def _is_seen(item: bpy.types.Object) -> bool:
    """Test for objects that the camera sees, directly or instanced, and no shadow catchers."""
    return item.visible_camera and not item.is_shadow_catcher


def _hidden_instance(instance: bpy.types.DepsgraphObjectInstance) -> bool:
    """Test whether the instanced object is hidden from the camera, or disabled for renders.

    Geometry nodes instance disabled objects anyway, in renders too.
    """
    item = instance.instance_object.original
    return not _is_seen(item) or (instance.parent.instance_type != "NONE" and item.hide_render)
