# SPDX-License-Identifier: GPL-3.0-or-later
"""Read the evaluated scene: modifiers, instances, curves and text as Blender sees them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial

import bpy
import numpy as np

from ...patchnet_addon.runtime.errors import EmptySelectionError, GeometryError, SettingError
from ...patchnet_addon.surface.mesh import Material
from ..schema.table import SELECTED, VISIBLE
from ..state.unsteady import origin_of_corners
from .gloss import Gloss, read_gloss
from .images import ImageReader
from .layer_names import layer_names
from .light_links import LightLinks
from .local_mesh import LocalMesh, read_local_mesh
from .materials import read_material
from .missing_files import missing_files, missing_libraries
from .object_random import object_random
from .render_geometry import render_geometry
from .scene_mesh import MeshInstances, SceneMesh
from .strands import STRANDS, Strands, finished, hair_modifiers, named, read_hair, read_strands
from .surface_instances import shown_instances, shows_itself, shows_mesh

_NO_MATERIAL = ""
_LEFT_OUT = {"GREASEPENCIL": "Grease pencil is", "VOLUME": "Volumes are"}  # by type of object


def read_scene(depsgraph: bpy.types.Depsgraph, scope: str = VISIBLE) -> SceneMesh:
    """Read the surface of the objects in scope ("SELECTED" or "VISIBLE") in world units, with their materials.

    Raises EmptySelectionError if nothing in scope has a surface, GeometryError if the surface has no area
    or coordinates that are not finite.
    """
    if scope not in (SELECTED, VISIBLE):
        raise SettingError(f"There is no scope {scope!r}: choose {SELECTED} or {VISIBLE}")
    reader = _Reader(depsgraph.view_layer.use_strand)
    with render_geometry(depsgraph):
        for instance in shown_instances(depsgraph, scope):
            reader.add(instance)
    parts, notes = reader.parts()
    notes += reader.left_out()
    if not parts:
        raise EmptySelectionError(". ".join([_nothing(scope), *notes, *missing_libraries()]))
    materials, gloss, warnings = reader.materials()
    in_use = [material for material in bpy.data.materials if material.name_full in reader.material_names]
    warnings = missing_files(in_use, depsgraph.scene.world) + warnings + notes
    warnings += _unlike_renders(depsgraph)
    links = tuple(reader.light_links.distinct)
    return SceneMesh(parts, materials, tuple(reader.material_names), warnings, links, gloss)


def _unlike_renders(depsgraph: bpy.types.Depsgraph) -> list[str]:
    """Sentences about what Cycles shows otherwise."""
    said = []
    if behind := depsgraph.scene.background_set:
        said.append(
            f"Objects of the background scene '{behind.name}' are left out of the voxels, though Cycles shows them: "
            "link its collections into this scene"
        )
    asking = [
        f"'{group.name}'"
        for group in bpy.data.node_groups
        if group.users and any(node.bl_idname == "GeometryNodeIsViewport" for node in group.nodes)
    ]
    if asking and depsgraph.mode != "RENDER":
        said.append(f"Geometry nodes {', '.join(asking)} ask Is Viewport, and are voxelized as a viewport shows them")
    return said


def _nothing(scope: str) -> str:
    if scope == SELECTED:
        return "No selected object has a surface: select a mesh, curve or text, or choose all visible objects"
    return "No visible object has a surface: show a mesh, curve or text and enable it for renders"


@dataclass(frozen=True, eq=False)
class _Placed:
    """Row of `MeshInstances`."""

    name: str
    matrix_world: np.ndarray
    slots: tuple[int, ...]
    random: float
    color: tuple[float, ...]
    index: int
    links: int

    def padded_slots(self, width: int) -> tuple[int, ...]:
        """Pad to `width` slots, the last one repeated, as Blender does for faces beyond the slots."""
        return (*self.slots, *(self.slots[-1:] * (width - len(self.slots))))


class _Reader:
    """Collector of instances; each mesh and each material once.

    hair: whether the view layer shows strands.
    """

    def __init__(self, hair: bool = True) -> None:
        self._hair = hair
        self.material_names: dict[str, int] = {}
        self.light_links = LightLinks()
        self._meshes: dict[tuple[object, ...], LocalMesh | Strands | None] = {}
        self._layer_names: dict[str, frozenset[str]] = {}
        self._placed: dict[tuple[object, ...], list[_Placed]] = {}
        self._left_out: dict[str, set[str]] = {}

    def add(self, instance: bpy.types.DepsgraphObjectInstance) -> None:
        """Read what the instance shows: its mesh, strands or points, and its hair."""
        item = instance.object
        layers = self._layers_of(item)
        if shows_mesh(instance):
            self._add(instance, self._key(instance), partial(_read_mesh, instance, layers))
        elif shows_itself(instance) and item.type in STRANDS and (self._hair or item.type != "CURVES"):
            self._add(instance, self._key(instance), partial(read_strands, item, layers))
        elif shows_itself(instance) and item.type in _LEFT_OUT:
            self._left_out.setdefault(item.type, set()).add(item.name)
        owner = instance.instance_object if instance.is_instance else item
        for modifier in hair_modifiers(owner) if self._hair and instance.show_particles else ():
            key = "hair", owner.original.as_pointer(), modifier.name, layers
            self._add(instance, key, partial(read_hair, owner, modifier, layers))

    def _add(
        self,
        instance: bpy.types.DepsgraphObjectInstance,
        key: tuple[object, ...],
        read: Callable[[], LocalMesh | Strands | None],
    ) -> None:
        """Note where a mesh stands, which is read if its key is a new one."""
        item = instance.object
        matrix = np.array(instance.matrix_world, np.float64)
        if not np.isfinite(matrix).all():
            raise GeometryError(
                f"Object '{item.name}' has a transform that is not finite: repair its position or scale"
            )
        if key not in self._meshes:
            self._meshes[key] = read()
        if self._meshes[key] is not None:
            slots = tuple(self._material(slot.material) for slot in item.material_slots)
            self._placed.setdefault(key, []).append(
                _Placed(
                    item.name, matrix, slots or (self._material(None),), object_random(instance), tuple(item.color),
                    item.pass_index, self.light_links.number(instance),
                )
            )  # fmt: skip

    def _key(self, instance: bpy.types.DepsgraphObjectInstance) -> tuple[object, ...]:
        """Objects share a mesh if they share evaluated data and the layers that their materials name."""
        item = instance.object
        return item.data.as_pointer(), self._layers_of(item)

    def _layers_of(self, item: bpy.types.Object) -> frozenset[str]:
        names: frozenset[str] = frozenset()
        for slot in item.material_slots:
            if slot.material:
                key = slot.material.original.name_full
                if key not in self._layer_names:
                    self._layer_names[key] = layer_names(slot.material)
                names |= self._layer_names[key]
        return names

    def _material(self, material: bpy.types.Material | None) -> int:
        name = material.original.name_full if material else _NO_MATERIAL
        return self.material_names.setdefault(name, len(self.material_names))

    def left_out(self) -> list[str]:
        """Sentences that name objects that renders show and that are no surface."""
        return [
            f"{_LEFT_OUT[kind]} left out, though renders show {named(sorted(names))}: convert such objects to meshes"
            for kind, names in self._left_out.items()
        ]

    def parts(self) -> tuple[tuple[MeshInstances, ...], list[str]]:
        """MeshInstances, all of them, mesh by mesh in the order of their first appearance, and sentences for users."""
        parts = []
        read = {key: mesh for key, mesh in self._meshes.items() if mesh is not None}
        meshes, notes = finished(read, {key: len(placed) for key, placed in self._placed.items()})
        for key, placed in self._placed.items():
            mesh = meshes[key]
            width = max(len(each.slots) for each in placed)
            parts.append(
                MeshInstances(
                    mesh=mesh,
                    objects=tuple(each.name for each in placed),
                    matrices_world=np.stack([each.matrix_world for each in placed]),
                    materials=np.array([each.padded_slots(width) for each in placed], np.int32),
                    random=np.array([each.random for each in placed]),
                    colors=np.array([each.color for each in placed], np.float32),
                    indices=np.array([each.index for each in placed], np.int32),
                    links=np.array([each.links for each in placed], np.int32),
                )
            )
        return tuple(parts), notes

    def materials(self) -> tuple[tuple[Material, ...], tuple[Gloss, ...], list[str]]:
        """Materials and their gloss in the order of their indices, and sentences about what was simplified."""
        images, warnings, result, gloss = ImageReader(), [], [], []
        library = {material.name_full: material for material in bpy.data.materials}
        for name in self.material_names:
            material, warning = read_material(library[name], images) if name else (Material("default"), None)
            result.append(material)
            gloss.append(read_gloss(library[name], images) if name else Gloss(diffuse=0.8))
            if warning:
                warnings.append(warning)
        return tuple(result), tuple(gloss), warnings


def _read_mesh(instance: bpy.types.DepsgraphObjectInstance, layers: frozenset[str]) -> LocalMesh | None:
    """Mesh of an instance as arrays."""
    item = instance.object
    with _evaluated_mesh(instance) as mesh:
        return mesh and read_local_mesh(mesh, item.name, layers, origin_of_corners(item))


@contextmanager
def _evaluated_mesh(instance: bpy.types.DepsgraphObjectInstance) -> Iterator[bpy.types.Mesh | None]:
    """Mesh of an instance."""
    item = instance.object
    if instance.is_instance and isinstance(item.data, bpy.types.Mesh):
        yield item.data  # it may belong to no object: geometry nodes instance meshes, curves evaluate to them
        return
    mesh = item.to_mesh()
    try:
        yield mesh
    finally:
        item.to_mesh_clear()
