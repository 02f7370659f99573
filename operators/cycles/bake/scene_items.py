# SPDX-License-Identifier: GPL-3.0-or-later
"""Scene items: what shines, shadows or reflects, each with a hash and its place, to tell what changed since a bake.

They are plain JSON values, since they are kept on disk beside the light that was baked of them.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

import bpy
import numpy as np

from ....patchnet_addon.lightmap.incremental.follow import Change
from ....patchnet_addon.lightmap.incremental.shadows import Lamp
from ....patchnet_addon.surface.chroma import REC709
from ...scene.strands import hair_modifiers
from ...scene_access.blender_version import tree_in_use
from ...scene_access.own import is_own
from ...state.digest import Digest
from ..daylight import (
    EMISSION_INPUTS,
    SKY_COLOR,
    SKY_STRENGTH,
    SUN_ANGLE,
    SUN_ROTATION,
    SUN_STRENGTH,
    emits,
)
from .bake_key import add_materials, add_object, add_world

Item = dict[str, Any]
_MOST_CHANGED = 64
_MOST_PAIRS = 4096  # of lamps and boxes, each of which asks all of the surface
_UNSEEN = ("CAMERA", "EMPTY", "SPEAKER", "LATTICE", "ARMATURE", "LIGHT_PROBE")
_SEQUENCES = ("SEQUENCE", "MOVIE")
_PLAIN_LAMP = frozenset({"EMISSION", "OUTPUT_LIGHT"})


class NotFollowedError(Exception):
    """Raised with a sentence where a change is one whose light nobody can follow: all is baked again."""


def scene_items(depsgraph: bpy.types.Depsgraph, daylight: bool) -> dict[str, Any]:
    """Everything that a bake's light depends on beside the surface's own triangles.

    daylight: whether sun and sky of ours shine in place of the scene's world. `all` is a hash of what lights all,
    `sky` the luminance of the world where it is brightest or None where nobody knows, `items` the rest one by one.
    """
    digest = Digest()
    if not daylight:
        add_world(digest, depsgraph)
    if any(image.source in _SEQUENCES for image in bpy.data.images):
        digest.text(depsgraph.scene.frame_current_final)
    items = [_sun_of_ours()] if daylight else []
    met: set[str] = set()
    boxes: dict[tuple[Any, ...], Item] = {}
    twins: list[tuple[Any, ...]] = []
    known: dict[tuple[str, int], tuple[str, bool]] = {}
    for instance in depsgraph.object_instances:
        item = instance.object
        if item.hide_render or is_own(item) or item.type in _UNSEEN:
            continue
        met.add(item.name_full)
        key = item.name_full, item.data.as_pointer() if item.data else 0
        if key not in known:
            of = item.original.evaluated_get(depsgraph) if instance.is_instance else item
            known[key] = _contents(of, item), _shines(item)
        placed = _placed(instance, *known[key])
        # A curve is there beside the mesh that renders make of it, and has no box of its own.
        twin = item.name_full, tuple(map(tuple, instance.matrix_world))
        if isinstance(item.data, bpy.types.Mesh) and "box" in placed:
            boxes[twin] = placed
        items.append(placed)
        twins.append(twin)
    for placed, twin in zip(items[len(items) - len(twins) :], twins, strict=True):
        if "box" in placed and twin in boxes:
            placed |= {"box": boxes[twin]["box"], "area": placed["area"] if boxes[twin] is placed else 0.0}
    for item in depsgraph.scene.original.objects:  # not in viewports, yet in renders
        known_or_own = item.name_full in met or is_own(item)
        if not known_or_own and not item.hide_render and item.type not in _UNSEEN:
            matrix = tuple(map(tuple, item.matrix_world))
            items.append({"key": _text_hash(matrix, _contents(item, item)), "kind": "unseen", "name": item.name_full})
    sky = _luminance(SKY_COLOR) * SKY_STRENGTH if daylight else sky_luminance(depsgraph.scene.world)
    return {"all": digest.hexdigest(), "daylight": daylight, "sky": sky, "items": items}


def change_of(before: dict[str, Any], now: dict[str, Any]) -> Change:
    """Change between two results of `scene_items`; raises NotFollowedError."""
    if before["all"] != now["all"] or before["daylight"] != now["daylight"]:
        raise NotFollowedError("the world or render settings changed")
    counts = Counter(item["key"] for item in before["items"])
    counts.subtract(item["key"] for item in now["items"])
    changed = [
        item
        for items, sign in ((before["items"], 1), (now["items"], -1))
        for item in items
        if counts[item["key"]] * sign > 0
    ]
    if not changed:
        return Change(np.empty((0, 2, 3)), np.empty(0))
    if now["sky"] is None:
        raise NotFollowedError("the light of an image or a sky texture is not followed")
    if len(changed) > _MOST_CHANGED:
        raise NotFollowedError("too much changed")
    boxes = [item["box"] for item in changed if item["kind"] == "surface"]
    areas = [item["area"] for item in changed if item["kind"] == "surface"]
    lit = tuple(_followed(item) for item in changed if item["kind"] != "surface")
    lamps = {item["key"]: item for items in (before["items"], now["items"]) for item in items}.values()
    shining = tuple(_lamp_of(item) for item in lamps if "place" in item)
    if len(shining) * len(boxes) > _MOST_PAIRS:
        raise NotFollowedError("too many lamps shine")
    return Change(np.array(boxes, np.float64).reshape(-1, 2, 3), np.array(areas, np.float64), shining, lit)


def _followed(item: Item) -> Lamp:
    """Changed lamp; raises NotFollowedError where nobody knows how bright it is."""
    if item.get("intensity") is None:
        raise NotFollowedError(f"the light of '{item['name']}' is not followed")
    return _lamp_of(item)


def _lamp_of(item: Item) -> Lamp:
    """Lamp of an item; of one whose changes are not followed, `at_most` is what a shadow can take."""
    known = item.get("intensity", item.get("at_most"))
    return Lamp(tuple(item["place"]), item["radius"], item["is_far"], math.inf if known is None else known)


def _contents(item: bpy.types.Object, shown: bpy.types.Object) -> str:
    digest = Digest()
    add_object(digest, item, shown.data)
    add_materials(digest, shown)
    return digest.hexdigest()


def _text_hash(*values: object) -> str:
    digest = Digest()
    digest.text(*values)
    return digest.hexdigest()


def _shines(item: bpy.types.Object) -> bool:
    return any(emits(slot.material) for slot in item.material_slots if slot.material)


def _placed(instance: bpy.types.DepsgraphObjectInstance, contents: str, shines: bool) -> Item:
    """Item of an instance."""
    item, matrix = instance.object, np.array(instance.matrix_world, np.float64)
    found: Item = {
        "key": _text_hash(item.name_full, contents, instance.show_self, instance.random_id, matrix.tolist()),
        "name": item.name_full,
    }
    if item.type == "LIGHT":
        return found | _lamp(item.data, matrix)
    if item.type == "VOLUME":
        return found | {"kind": "volume"}
    box = _box(matrix, _points(item))
    found |= {"box": box, "area": _area(item, matrix)}
    if not shines:  # the hair of an object is not in its box
        return found | {"kind": "hair" if any(hair_modifiers(item)) else "surface"}
    low, high = np.array(box)
    around = {"place": ((low + high) / 2).tolist(), "radius": float(np.linalg.norm(high - low) / 2), "is_far": False}
    at_most = None if math.isinf(found["area"]) else emission_at_most(item)
    sent = None if at_most is None else at_most * found["area"]  # no view of it is larger than its surface
    return found | {"kind": "emitter"} | around | {"at_most": sent}


def emission_at_most(item: bpy.types.Object) -> float | None:
    """Luminance that an object sends out where it is brightest, or more; None where nobody knows."""
    brightest = 0.0
    for slot in item.material_slots:
        if not slot.material or not emits(slot.material):
            continue
        sent = 0.0  # of all its nodes together: none is mixed by more than 1
        for node in slot.material.node_tree.nodes:
            names = EMISSION_INPUTS.get(node.type)
            if names is None:
                continue
            color, strength = (node.inputs[name] for name in names)
            if color.is_linked or strength.is_linked:
                return None
            sent += max(_luminance(color.default_value), 0.0) * max(strength.default_value, 0.0)
        brightest = max(brightest, sent)
    return brightest


def _points(item: bpy.types.Object) -> np.ndarray:
    """Points (N, 3) around which the smallest box holds all of an object."""
    data = item.data
    if not isinstance(data, bpy.types.Mesh) or not len(data.vertices):
        return np.array(item.bound_box, np.float64)
    points = np.empty(3 * len(data.vertices), np.float32)
    data.vertices.foreach_get("co", points)
    return points.reshape(-1, 3).astype(np.float64)


def _area(item: bpy.types.Object, matrix: np.ndarray) -> float:
    """Surface of an object in world units, or more; infinite where nobody knows."""
    data = item.data
    if not isinstance(data, bpy.types.Mesh):
        return math.inf
    areas = np.empty(len(data.polygons), np.float32)
    data.polygons.foreach_get("area", areas)
    return float(areas.sum(dtype=np.float64) * np.linalg.norm(matrix[:3, :3], ord=2) ** 2)


def _box(matrix: np.ndarray, points: np.ndarray) -> list[list[float]]:
    world = points @ matrix[:3, :3].T + matrix[:3, 3]
    return [world.min(axis=0).tolist(), world.max(axis=0).tolist()]


def _lamp(lamp: bpy.types.Light, matrix: np.ndarray) -> Item:
    place = matrix[:3, 3].tolist()
    if lamp.type == "SUN":
        towards = matrix[:3, 2] / np.linalg.norm(matrix[:3, 2])
        radius = math.tan(min(lamp.angle, 3.0) / 2)
        sun = {"kind": "sun", "place": towards.tolist(), "radius": radius, "is_far": True}
        return sun | {"at_most": _strength(lamp)}
    scale = float(np.linalg.norm(matrix[:3, :3], axis=0).max())
    if lamp.type == "AREA":
        width = lamp.size
        height = lamp.size_y if lamp.shape in ("RECTANGLE", "ELLIPSE") else lamp.size
        radius = math.hypot(width, height) / 2 * scale
    else:
        radius = lamp.shadow_soft_size * scale
    found = {"kind": "lamp", "place": place, "radius": float(radius), "is_far": False}
    intensity = _intensity(lamp)
    return found if intensity is None else found | {"intensity": intensity}


def _intensity(lamp: bpy.types.Light) -> float | None:
    """Radiant intensity of a lamp where it is strongest, as luminance; None where nodes or a narrow spread decide."""
    if lamp.type == "AREA" and getattr(lamp, "spread", math.pi) < math.pi - 1e-3:
        return None
    strength = _strength(lamp)
    return None if strength is None else float(strength / (math.pi if lamp.type == "AREA" else 4.0 * math.pi))


def _strength(lamp: bpy.types.Light) -> float | None:
    """Power of a lamp, or what falls on a plane that faces a sun, as luminance; None where nodes decide."""
    if not getattr(lamp, "normalize", True):
        return None
    strength = lamp.energy * 2.0 ** getattr(lamp, "exposure", 0.0) * _luminance(_color(lamp))
    tree = tree_in_use(lamp)
    if tree is not None:
        emission = [node for node in tree.nodes if node.type == "EMISSION"]
        plain = {node.type for node in tree.nodes} <= _PLAIN_LAMP and len(emission) == 1
        if not plain or any(socket.is_linked for socket in emission[0].inputs):
            return None
        strength *= emission[0].inputs["Strength"].default_value
        strength *= _luminance(emission[0].inputs["Color"].default_value)
    return float(strength)


def _color(lamp: bpy.types.Light) -> np.ndarray:
    color = np.array(lamp.color[:3], np.float64)
    return color * np.array(lamp.temperature_color[:3]) if getattr(lamp, "use_temperature", False) else color


def _luminance(color: Any) -> float:
    return float(np.dot(np.asarray(color[:3]), REC709))


def sky_luminance(world: bpy.types.World | None) -> float | None:
    """Luminance of a world where it is brightest; None where that is not to be read from its nodes, as of an image."""
    if world is None:
        return 0.0
    tree = tree_in_use(world)
    if tree is None:
        return _luminance(world.color)
    output = tree.get_output_node("CYCLES")
    if output is None or output.inputs["Volume"].is_linked:
        return None if output else 0.0
    links = output.inputs["Surface"].links
    if not links:
        return 0.0
    background = links[0].from_node
    if background.type != "BACKGROUND" or background.mute or background.inputs["Strength"].is_linked:
        return None
    color = _brightest(background.inputs["Color"])
    return None if color is None else color * float(background.inputs["Strength"].default_value)


def _brightest(socket: bpy.types.NodeSocket) -> float | None:
    """Luminance of a colour where it is brightest: of a plain one, or of a ramp of colours."""
    if not socket.is_linked:
        return _luminance(socket.default_value)
    node = socket.links[0].from_node
    if node.mute:
        return None
    if node.type == "RGB":
        return _luminance(node.outputs[0].default_value)
    if node.type == "VALTORGB":  # splines between stops may reach beyond them, by less than a half
        ramp = node.color_ramp
        over = 1.5 if ramp.interpolation in ("CARDINAL", "B_SPLINE") or ramp.color_mode != "RGB" else 1.0
        return over * max(_luminance(stop.color) for stop in ramp.elements)
    return None


def _sun_of_ours() -> Item:
    """Item of the sun of `daylight`."""
    from mathutils import Euler

    towards = list(Euler(SUN_ROTATION).to_matrix().col[2])
    around = {"place": towards, "radius": math.tan(SUN_ANGLE / 2), "is_far": True, "at_most": SUN_STRENGTH}
    return {"key": "sun", "name": "PatchNet Sun", "kind": "sun"} | around
