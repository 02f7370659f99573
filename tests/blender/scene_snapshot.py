# SPDX-License-Identifier: GPL-3.0-or-later
"""Compare everything in a .blend that a job could change, before and after.

before = scene_snapshot()
...
assert_unchanged(before)
"""

import hashlib
from typing import Any

import bpy
import numpy as np

_NODES_ALWAYS = bpy.app.version >= (5, 0, 0)  # windows import this file without the package
_ATTRIBUTES = {
    "FLOAT": ("value", 1, np.float32), "FLOAT2": ("vector", 2, np.float32), "FLOAT_VECTOR": ("vector", 3, np.float32),
    "FLOAT_COLOR": ("color", 4, np.float32), "BYTE_COLOR": ("color", 4, np.float32), "INT": ("value", 1, np.int32),
    "BOOLEAN": ("value", 1, np.bool_),
}  # fmt: skip
# What Blender itself brings along and nobody counts as part of the scene.
_SKIPPED_COLLECTIONS = {"screens", "window_managers", "workspaces", "brushes", "palettes", "rna_type", "libraries"}
# Pointers between data-blocks and views of them; the data-blocks appear on their own.
_SKIPPED_PROPERTIES = {
    "rna_type", "original", "session_uid", "id_data", "is_evaluated", "preview", "users", "depsgraph",
    "is_library_indirect",  # Blender 5.3 makes it false where a script sets what it was, and true again in each save
}  # fmt: skip
# Blender 4.5 makes the lists of what is selected in a UV map when they are read, named by memory that it has freed.
_SKIPPED_OF_UV_MAPS = {"vertex_selection", "edge_selection", "pin"}
# Notes of a simulation's cache about the frames that were seen. Any jump to another frame makes and changes them.
_SKIPPED_NOTES = {"info", "is_frame_skip", "is_outdated"}
_DEPTH = 4
# Items of lists that are compared with all their settings; of others the name counts.
_LISTED = (
    bpy.types.MaterialSlot | bpy.types.Modifier | bpy.types.LayerCollection | bpy.types.ViewLayer | bpy.types.Constraint
    | bpy.types.ColorRampElement | bpy.types.CurveMap | bpy.types.CurveMapPoint | bpy.types.DriverVariable
    | bpy.types.FCurve | bpy.types.Keyframe | bpy.types.NlaTrack | bpy.types.NlaStrip | bpy.types.ParticleSystem
    | bpy.types.VertexGroup
)  # fmt: skip


def scene_snapshot() -> dict[str, Any]:
    """All data-blocks with their settings, users, node trees, mesh arrays and pixels; selection, mode, visibility.

    Of settings also which were ever set; view layers and what they leave out; handlers; Cycles' devices.
    """
    snapshot: dict[str, Any] = {}
    for name in dir(bpy.data):
        collection = getattr(bpy.data, name)
        if name in _SKIPPED_COLLECTIONS or not isinstance(collection, bpy.types.bpy_prop_collection):
            continue
        for block in collection:
            snapshot[f"{name}[{block.name_full}]"] = _block(block)
    snapshot["context"] = _context()
    snapshot["handlers"] = {
        name: [str(function) for function in handlers]
        for name in dir(bpy.app.handlers)
        if isinstance(handlers := getattr(bpy.app.handlers, name), list)
    }
    addon = bpy.context.preferences.addons.get("cycles")
    snapshot["devices"] = _settings(addon.preferences, _DEPTH) if addon else None
    return snapshot


def assert_unchanged(before: dict[str, Any]) -> None:
    """Fail with what differs between `before` and now."""
    differences = _differences(before, scene_snapshot(), "")
    assert not differences, "\n".join(differences[:20])


def _differences(before: Any, after: Any, path: str) -> list[str]:
    if isinstance(before, dict) and isinstance(after, dict):
        found = []
        for key in [*before, *(key for key in after if key not in before)]:
            if key not in after:
                found.append(f"{path}.{key} is gone")
            elif key not in before:
                found.append(f"{path}.{key} is new")
            else:
                found.extend(_differences(before[key], after[key], f"{path}.{key}"))
        return found
    return [] if before == after else [f"{path} was {before!r}, is {after!r}"]


def _context() -> dict[str, Any]:
    state: dict[str, Any] = {"scene": bpy.context.scene.name, "mode": bpy.context.mode}
    for scene in bpy.data.scenes:
        for layer in scene.view_layers:
            active = layer.objects.active
            state[f"{scene.name}/{layer.name}"] = {
                "active": active.name if active else None,
                "selected": sorted(item.name for item in layer.objects if item.select_get(view_layer=layer)),
                "hidden": sorted(item.name for item in layer.objects if item.hide_get(view_layer=layer)),
                "objects": sorted(item.name for item in layer.objects),
                "modes": {item.name: item.mode for item in layer.objects},
            }
    return state


def _block(block: bpy.types.ID) -> dict[str, Any]:
    values = {"users": block.users, "settings": _settings(block, _DEPTH), "custom": _custom(block)}
    tree = block if isinstance(block, bpy.types.NodeTree) else getattr(block, "node_tree", None)
    if tree is not None:
        values["nodes"] = _tree(tree)
    if isinstance(block, bpy.types.Scene):
        owners = {"render": block.render, "cycles": block.cycles, "bake": block.render.bake}
        values["set"] = {name: _set_properties(owner) for name, owner in owners.items()}
    if isinstance(block, bpy.types.Mesh):
        values["arrays"] = _mesh(block)
    if isinstance(block, bpy.types.Image) and block.has_data:
        pixels = np.empty(len(block.pixels), np.float32)
        block.pixels.foreach_get(pixels)
        values["pixels"] = hashlib.sha256(pixels).hexdigest()
    return values


def _set_properties(owner: bpy.types.bpy_struct) -> list[str]:
    """Properties that do not just have their default value."""
    return [prop.identifier for prop in owner.bl_rna.properties if owner.is_property_set(prop.identifier)]


def _settings(owner: bpy.types.bpy_struct, depth: int) -> dict[str, Any]:
    """Values of all properties, those of nested settings too; other data-blocks by name."""
    result: dict[str, Any] = {}
    for prop in owner.bl_rna.properties:
        key = prop.identifier
        if key in _SKIPPED_PROPERTIES or (key == "use_nodes" and _NODES_ALWAYS):
            continue
        if isinstance(owner, bpy.types.PointCache) and key in _SKIPPED_NOTES:
            continue
        if isinstance(owner, bpy.types.MeshUVLoopLayer) and key in _SKIPPED_OF_UV_MAPS:
            continue
        if isinstance(owner, bpy.types.Mesh) and prop.type == "COLLECTION":
            continue
        try:
            value = getattr(owner, key)
        except (AttributeError, ValueError, RuntimeError, TypeError):
            continue  # not readable in this state
        if prop.type == "POINTER":
            if isinstance(value, bpy.types.ID):
                result[key] = value.name_full
            elif value is not None and depth > 0 and key != "node_tree":
                result[key] = _settings(value, depth - 1)
        elif prop.type == "COLLECTION":
            result[key] = [_label(each, depth) for each in value]
        elif getattr(prop, "is_array", False):
            result[key] = tuple(np.ravel(np.array(value)).tolist())
        elif not callable(value):
            result[key] = value if isinstance(value, bool | int | float | str) else str(value)
    return result


def _label(item: Any, depth: int) -> Any:
    if isinstance(item, bpy.types.ID):
        return item.name_full
    if depth > 0 and hasattr(item, "bl_rna") and isinstance(item, _LISTED):
        return _settings(item, depth - 1)
    return getattr(item, "name", type(item).__name__)


def _custom(block: bpy.types.ID) -> dict[str, str]:
    """Custom properties; a group's contents, not where it lies in memory."""
    values = {key: block[key] for key in block.keys()}  # noqa: SIM118
    return {key: str(value.to_dict() if hasattr(value, "to_dict") else value) for key, value in values.items()}


def _tree(tree: bpy.types.NodeTree) -> dict[str, Any]:
    nodes: dict[str, Any] = {node.name: _node(node) for node in tree.nodes}
    links = sorted(
        f"{link.from_node.name}.{link.from_socket.identifier}>{link.to_node.name}.{link.to_socket.identifier}"
        for link in tree.links
    )
    return {"nodes": nodes, "links": links, "active": tree.nodes.active.name if tree.nodes.active else None}


def _node(node: bpy.types.Node) -> dict[str, Any]:
    values = {socket.identifier: getattr(socket, "default_value", None) for socket in node.inputs}
    inputs = {key: tuple(value) if hasattr(value, "__len__") else str(value) for key, value in values.items()}
    return {"settings": _settings(node, 2), "inputs": inputs}


def _mesh(mesh: bpy.types.Mesh) -> dict[str, Any]:
    arrays: dict[str, Any] = {
        "sizes": (len(mesh.vertices), len(mesh.edges), len(mesh.loops), len(mesh.polygons)),
        "attributes": [(each.name, each.domain, each.data_type) for each in mesh.attributes],
        "uvs": [(layer.name, layer.active, layer.active_render) for layer in mesh.uv_layers],
        "materials": [material.name_full if material else None for material in mesh.materials],
    }
    for attribute in mesh.attributes:
        if (kind := _ATTRIBUTES.get(attribute.data_type)) is not None:
            values = np.empty(len(attribute.data) * kind[1], kind[2])
            attribute.data.foreach_get(kind[0], values)
            arrays[f"values of {attribute.name}"] = hashlib.sha256(values).hexdigest()
    return arrays
