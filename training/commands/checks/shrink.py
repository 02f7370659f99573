# SPDX-License-Identifier: GPL-3.0-or-later
"""Shrinker of a scene whose light is wrong: what it stays wrong without is left out."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import bpy

from ....operators.scene.files import open_scene
from .judge import WRONG, Verdict, judge
from .materials import make_plain

_EASED_DB = 3.0
_RAYS = ("visible_camera", "visible_diffuse", "visible_glossy", "visible_transmission", "visible_shadow")
_SHOWN = {"hide_viewport": False, "hide_render": False, "is_holdout": False} | dict.fromkeys(_RAYS, True)
_UPRIGHT = {"parent": None, "rotation_euler": (0.0, 0.0, 0.0), "scale": (1.0, 1.0, 1.0)}


def shrink(path: Path, small: Path) -> Verdict:
    """Open the wrong scene at `path`, and write what is left of it to `small`; returns the verdict on that.

    What is wrong with it stays of one kind, see `Verdict.kind`, and about as wrong.
    """
    open_scene(path)
    save_scene(small)
    first = verdict = judge()
    trial = small.with_name(f"trial-{small.name}")
    for change in list(_changes()):
        open_scene(small)
        if not _changed(change):
            continue
        save_scene(trial)  # judging may change the scene
        found = judge()
        if found.word == WRONG and found.kind == first.kind and found.short_db >= first.short_db - _EASED_DB:
            verdict = found
            trial.replace(small)
    trial.unlink(missing_ok=True)
    return verdict


def _changed(change: Callable[[], bool]) -> bool:
    try:
        return change()
    except KeyError:
        return False


def save_scene(path: Path) -> None:
    """Save the open scene to a new file, without what nothing uses."""
    bpy.data.orphans_purge(do_recursive=True)
    path.unlink(missing_ok=True)  # otherwise Blender keeps it as .blend1
    bpy.ops.wm.save_as_mainfile(filepath=str(path.absolute()), copy=True, compress=True)


def contents(path: Path) -> str:
    """Open a scene file, and list its objects with modifiers, and its materials with nodes, in a line."""
    open_scene(path)
    items = [
        f"{item.name} ({', '.join(each.type for each in item.modifiers)})" if item.modifiers else item.name
        for item in bpy.data.objects
    ]
    paints = [f"{each.name} ({', '.join(map(_title, _nodes(each)))})" for each in bpy.data.materials]
    return "; ".join(sorted(items) + sorted(paints))


def _title(node: bpy.types.Node) -> str:
    return node.bl_idname.removeprefix("ShaderNode")


def _nodes(material: bpy.types.Material) -> list[bpy.types.Node]:
    tree = material.node_tree
    return [] if tree is None else [node for node in tree.nodes if node.type != "OUTPUT_MATERIAL"]


def _changes() -> Iterator[Callable[[], bool]]:
    """Changes from coarse to fine; each returns whether it changed anything; KeyError means that its target is gone."""
    items = [item.name for item in bpy.data.objects if item != bpy.context.scene.camera]
    yield from (partial(_remove_object, name) for name in items)
    yield _plain_world
    for material in bpy.data.materials:
        yield partial(_plain, material.name)
    for item in bpy.data.objects:
        yield from (partial(_remove_modifier, item.name, modifier.name) for modifier in item.modifiers)
        yield partial(_set, item.name, _SHOWN)
    yield from (partial(_set, name, _UPRIGHT) for name in items)
    for material in bpy.data.materials:
        yield from (partial(_remove_node, material.name, node.name) for node in _nodes(material))


def _remove_object(name: str) -> bool:
    bpy.data.objects.remove(bpy.data.objects[name])
    return True


def _plain_world() -> bool:
    """Leave the world a colour without nodes."""
    world = bpy.context.scene.world
    links = world.node_tree.links if world and world.node_tree else []
    linked = [link for link in links if link.to_node.type == "BACKGROUND"]
    for link in linked:
        link.id_data.links.remove(link)
    return bool(linked)


def _plain(name: str) -> bool:
    material = bpy.data.materials[name]
    if [_title(node) for node in _nodes(material)] == ["BsdfDiffuse"]:
        return False
    make_plain(material)
    return True


def _remove_modifier(name: str, modifier: str) -> bool:
    modifiers = bpy.data.objects[name].modifiers
    modifiers.remove(modifiers[modifier])
    return True


def _set(name: str, values: dict[str, Any]) -> bool:
    """Set properties of an object."""
    item = bpy.data.objects[name]
    before = [getattr(item, key) for key in values]
    changed = any((each[:] if isinstance(value, tuple) else each) != value
                  for each, value in zip(before, values.values(), strict=True))  # fmt: skip
    for key, value in values.items():
        setattr(item, key, value)
    return changed


def _remove_node(name: str, node_name: str) -> bool:
    """Remove a node; its first input of the same type takes the place of its output."""
    tree = bpy.data.materials[name].node_tree
    node = tree.nodes[node_name]
    for target in [link.to_socket for output in node.outputs for link in output.links]:
        same = [socket for socket in node.inputs if socket.is_linked and socket.type == target.type]
        if same:
            tree.links.new(same[0].links[0].from_socket, target)
    tree.nodes.remove(node)
    return True
