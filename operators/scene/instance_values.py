# SPDX-License-Identifier: GPL-3.0-or-later
"""Values that shader nodes read from a placed object: Object Info, Particle Info, attributes, instancer's coordinates.

They are constant over an object, so they are read once per placement. The rules are those of Cycles' Blender side
(`blender/object.cpp`, `blender/particles.cpp`) and of `BKE_object_dupli_find_rgba_attribute`.
"""

from __future__ import annotations

from typing import NamedTuple

import bpy
import numpy as np

from ..scene_access.blender_version import tree_in_use
from ..state.digest import ATTRIBUTE_KINDS, values_of
from .layer_names import all_nodes, own_name

_MASK = 0xFFFFFFFF
_NO_ID = 2**31 - 1
_OBJECT = frozenset({"Location", "Color", "Alpha", "Object Index", "Random"})
_PARTICLE = {
    "Location": "location", "Lifetime": "lifetime", "Size": "size", "Velocity": "velocity",
    "Angular Velocity": "angular_velocity",
}  # fmt: skip
_PARTICLE_OUTPUTS = frozenset({"Index", "Random", "Age", *_PARTICLE})


class Asked(NamedTuple):
    """Value that nodes read: of an "object", a "particle", an "instancer", or an attribute of OBJECT or INSTANCER."""

    kind: str
    key: str

    @property
    def layer(self) -> str:
        """Name of the layer that holds it."""
        return own_name(self.kind, self.key)


def asked_by(node: bpy.types.Node, output: str) -> Asked | None:
    """Value of the placed object behind an output of a node; None for other outputs."""
    if node.type == "OBJECT_INFO" and output in _OBJECT:
        return Asked("object", output)
    if node.type == "PARTICLE_INFO" and output in _PARTICLE_OUTPUTS:
        return Asked("particle", output)
    if node.type == "ATTRIBUTE" and node.attribute_type in ("OBJECT", "INSTANCER"):
        return Asked(node.attribute_type, node.attribute_name)
    if node.type == "UVMAP" and node.from_instancer:
        return Asked("instancer", "UV")
    if node.type == "TEX_COORD" and node.from_instancer and output in ("Generated", "UV"):
        return Asked("instancer", output)
    return None


def asked_values(material: bpy.types.Material) -> frozenset[Asked]:
    """All values that nodes of a material, and of its groups, read from its objects."""
    tree = tree_in_use(material)
    outputs = [(node, socket) for node in all_nodes(tree) for socket in node.outputs] if tree else []
    found = (asked_by(node, socket.name) for node, socket in outputs if socket.is_linked)
    return frozenset(asked for asked in found if asked is not None)


class InstanceReader:
    """Reader of values of placed objects; `unknown` are attributes that no placed object has."""

    def __init__(self, frame: float) -> None:
        self.unknown: set[str] = set()
        self._known: set[str] = set()
        self._frame = frame
        self._attributes: dict[tuple[int, str], np.ndarray | None] = {}

    def value(self, instance: bpy.types.DepsgraphObjectInstance, asked: Asked) -> tuple[float, ...]:
        """Value of 1 to 4 numbers, a fixed count for each `asked`; an attribute has 4, zeros if it is missing."""
        if asked.kind == "object":
            return _of_object(instance, asked.key)
        if asked.kind == "particle":
            return self._of_particle(instance, asked.key)
        if asked.kind == "instancer":
            return (*instance.uv, 0.0) if asked.key == "UV" else tuple(0.5 * value - 0.5 for value in instance.orco)
        found = self._attribute(instance, asked)
        (self.unknown.add if found is None else self._known.add)(asked.key)
        self.unknown -= self._known
        return (0.0,) * 4 if found is None else found

    def _of_particle(self, instance: bpy.types.DepsgraphObjectInstance, key: str) -> tuple[float, ...]:
        number = instance.persistent_id[0]
        system = instance.particle_system if instance.is_instance else None
        if system is None or number >= len(system.particles):  # children too
            number, particle = 0, None
        else:
            particle = system.particles[number]
        if key == "Index":
            return (float(number),)
        if key == "Random":
            return (_hash(number) / _MASK,)
        if key == "Age":
            return (0.0 if particle is None else self._frame - particle.birth_time,)
        value = getattr(particle, _PARTICLE[key], None)
        if isinstance(value, float):
            return (value,)
        if value is None:
            return (0.0,) * (1 if key in ("Lifetime", "Size") else 3)
        return tuple(value)

    def _attribute(self, instance: bpy.types.DepsgraphObjectInstance, asked: Asked) -> tuple[float, ...] | None:
        """Color of an attribute: the instance's own, else its instancer's, else the object's or its data's."""
        owners: list[bpy.types.ID] = []
        if asked.kind == "INSTANCER" and instance.is_instance:
            if (own := self._of_instance(instance, asked.key)) is not None:
                return own
            owners = [instance.particle_system.settings] if instance.particle_system else []
            owners.append(instance.parent)
        owners += [instance.object, *([instance.object.data] if instance.object.data else [])]
        return next((value for owner in owners if (value := _property(owner, asked.key)) is not None), None)

    def _of_instance(self, instance: bpy.types.DepsgraphObjectInstance, name: str) -> tuple[float, ...] | None:
        """Attribute that geometry nodes gave the instance; of nested ones, the outermost."""
        parent = instance.parent
        key = parent.as_pointer(), name
        if key not in self._attributes:
            self._attributes[key] = _instance_attribute(parent, name)
        values = self._attributes[key]
        numbers = [number for number in instance.persistent_id if number != _NO_ID]
        if values is None or not numbers or numbers[-1] >= len(values):
            return None
        return tuple(values[numbers[-1]].tolist())


def _of_object(instance: bpy.types.DepsgraphObjectInstance, key: str) -> tuple[float, ...]:
    item = instance.object
    if key == "Location":
        return tuple(instance.matrix_world.translation)
    if key == "Object Index":
        return (float(item.pass_index),)
    if key == "Random":
        return (_object_random(instance),)
    return tuple(item.color)[:3] if key == "Color" else (item.color[3],)


def _instance_attribute(parent: bpy.types.Object, name: str) -> np.ndarray | None:
    """Colors (N, 4) float32 of an attribute of all instances of an evaluated object."""
    if parent.type == "EMPTY":  # has no geometry
        return None
    geometry = parent.evaluated_geometry()  # keeps the cloud alive
    cloud = geometry.instances_pointcloud()
    attribute = cloud and cloud.attributes.get(name)
    if not attribute or attribute.data_type not in ATTRIBUTE_KINDS:
        return None
    key, width, dtype = ATTRIBUTE_KINDS[attribute.data_type]
    rows = values_of(attribute.data, key, width, dtype).reshape(-1, width)
    return np.array([_color(row) for row in rows], np.float32)


def _property(owner: bpy.types.ID, name: str) -> tuple[float, ...] | None:
    """Color of a custom property of a data-block, or of a property by its path."""
    for path in (f'["{bpy.utils.escape_identifier(name)}"]', name):
        try:
            value = owner.path_resolve(path)
        except (ValueError, TypeError, AttributeError):
            continue
        numbers = [value] if isinstance(value, bool | int | float) else list(value) if hasattr(value, "__len__") else []
        if 1 <= len(numbers) <= 4 and all(isinstance(each, bool | int | float) for each in numbers):
            return _color([float(each) for each in numbers])
    return None


def _color(numbers: list[float] | np.ndarray) -> tuple[float, ...]:
    """Color of 1 to 4 numbers, as shaders read it: a number is gray, a vector opaque."""
    values = [float(each) for each in numbers]
    return (*(values * 3 if len(values) == 1 else values + [0.0])[:3], 1.0) if len(values) < 4 else tuple(values)


def _object_random(instance: bpy.types.DepsgraphObjectInstance) -> float:
    """Random number in [0, 1] as in Cycles: of an instance by its id, of an object by its name."""
    if instance.is_instance:
        return (instance.random_id & _MASK) / _MASK
    value = 0
    for byte in instance.object.name.encode():  # polynomial hash with base 37
        value = (value * 37 + byte) & _MASK
    return _hash(value) / _MASK


def _hash(x: int) -> int:
    """Hash two words, the second 0, by Bob Jenkins' lookup3."""
    a = b = c = (0xDEADBEEF + (2 << 2) + 13) & _MASK
    a = (a + x) & _MASK
    c = ((c ^ b) - _rotated(b, 14)) & _MASK
    a = ((a ^ c) - _rotated(c, 11)) & _MASK
    b = ((b ^ a) - _rotated(a, 25)) & _MASK
    c = ((c ^ b) - _rotated(b, 16)) & _MASK
    a = ((a ^ c) - _rotated(c, 4)) & _MASK
    b = ((b ^ a) - _rotated(a, 14)) & _MASK
    return ((c ^ b) - _rotated(b, 24)) & _MASK


def _rotated(value: int, bits: int) -> int:
    return ((value << bits) | (value >> (32 - bits))) & _MASK
