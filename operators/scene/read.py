# SPDX-License-Identifier: GPL-3.0-or-later
"""Reader of the evaluated scene with modifiers, instances, curves and text."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from functools import partial
from typing import NamedTuple

import bpy
import numpy as np

from ...patchnet_addon.runtime.errors import EmptySelectionError
from ...patchnet_addon.runtime.omissions import Omissions
from ...patchnet_addon.runtime.progress import Progress, Steps, drain
from ...patchnet_addon.runtime.quantities import named_list, subject
from ...patchnet_addon.surface.local_mesh import LocalMesh
from ...patchnet_addon.surface.mesh import Material
from ...patchnet_addon.surface.scene_mesh import MeshInstances, SceneMesh, with_opacities
from ..scene_access.temporary import mesh_copy, temporary_meshes
from ..schema.values import SELECTED, VISIBLE
from ..state.digest import origin_of_corners
from .coincident import coincidence_warnings
from .files import missing_files, missing_libraries
from .gloss import DIFFUSE
from .images import ImageReader
from .instance_values import Asked, InstanceReader, asked_values
from .layer_names import layer_names
from .light_links import LightLinks
from .local_mesh import MeshToRead, read_local_mesh
from .materials import MaterialReading, at_least_half_opaque, is_partly_transparent, read_material
from .render_geometry import cut_out_objects, render_geometry, shown_instances, shows_itself, shows_mesh
from .strands import STRANDS, Strands, finished, hair_modifiers, read_hair, read_strands

_READING = Progress(0, 1, "Reading the scene")
_NO_MATERIAL = ""
_NOTHING = {
    SELECTED: "No selected object has a surface: select a mesh, curve or text, or choose all visible objects",
    VISIBLE: "No visible object has a surface: add a mesh, curve or text, or enable it for renders",
}
_NOT_FINITE = "that are not finite numbers (NaN or infinite)"
LEFT_OUT = {"GREASEPENCIL": "Grease pencil is", "VOLUME": "Volumes are"}  # by type of object


def read_scene(depsgraph: bpy.types.Depsgraph, scope: str = VISIBLE, chosen: frozenset[int] | None = None) -> SceneMesh:
    """Read a surface at once, see `scene_surface`."""
    return drain(scene_surface(depsgraph, scope, chosen))


def scene_surface(
    depsgraph: bpy.types.Depsgraph, scope: str = VISIBLE, chosen: frozenset[int] | None = None
) -> Steps[SceneMesh]:
    """Read the surface of the objects in scope ("SELECTED" or "VISIBLE") in world units, with their materials.

    The first step copies all meshes, since their evaluation is Blender's and the window may change it; then one mesh
    or material a step. chosen: session_uids of objects that count as selected. Raises EmptySelectionError if nothing
    in scope has a surface, GeometryError if it has no area, or faces without vertices.
    """
    layer = depsgraph.view_layer
    # Data stay as they are while a graph renders. To remove some, even none, in its thread pulls the layers from under
    # a window that draws.
    with nullcontext() if depsgraph.mode == "RENDER" else temporary_meshes() as copies:
        reader = _Reader(
            depsgraph.scene.frame_current_final, hair=layer.use_strand, solid=layer.use_solid, copies=copies
        )
        with render_geometry(depsgraph):
            for instance in shown_instances(depsgraph, scope, chosen):
                reader.add(instance)
        yield from reader.meshes()
    parts, notes = reader.parts()
    notes += reader.left_out()
    if not layer.use_solid:  # bakes of Cycles take all meshes
        notes.append(f"View layer '{layer.name}' shows no Surfaces: meshes have no voxels, but still shadow hair")
    if not parts:
        raise EmptySelectionError(". ".join([_NOTHING[scope], *notes, *missing_libraries()]))
    unlike = _unlike_renders(depsgraph, {name for part in parts for name in part.objects})
    in_use = [material for material in bpy.data.materials if material.name_full in reader.material_names]
    warnings = missing_files(in_use, depsgraph.scene.world)
    readings = yield from reader.materials()
    opacities = [with_opacities(each.material, number, parts) for number, each in enumerate(readings)]
    if partly := [each.name for each in opacities if is_partly_transparent(each)]:
        what = (
            "partly transparent: left out where less than half opaque, solid in previews; Refine with Cycles shows it"
        )
        warnings.append(f"{subject('Material', partly)} {what}")
    warnings += notes + unlike
    if unknown := named_list(sorted(reader.instance_reader.unknown)):
        warnings.append(f"Materials read attribute {unknown}, which no object or instance has: it counts as 0")
    warnings += [reading.note for reading in readings if reading.note]
    warnings += reader.unread_materials.sentences("Material", "read as plain gray")
    links = tuple(reader.light_links.distinct)
    materials = tuple(at_least_half_opaque(reading.material) for reading in readings)
    color_warnings = tuple(reading.color_note for reading in readings if reading.color_note)
    gloss = tuple(reading.gloss for reading in readings)
    yield _READING
    source = SceneMesh(parts, materials, tuple(reader.material_names), warnings, links, gloss, color_warnings)
    yield _READING
    warnings += coincidence_warnings(source)
    return source


def _unlike_renders(depsgraph: bpy.types.Depsgraph, names: set[str]) -> list[str]:
    """Sentences about differences to Cycles, of the voxelized objects `names`."""
    scene, said = depsgraph.scene, []
    items = [item for item in bpy.data.objects if item.name in names and hasattr(item, "cycles")]
    if diced := named_list(item.name for item in items if _is_diced(item, scene)):
        said.append(f"Adaptive Subdivision of {diced} is left out: raise Levels Render, which voxels have")
    kinds = ("use_camera_cull", "use_distance_cull") if scene.render.use_simplify and items else ()
    on = [name for name in kinds if getattr(scene.cycles, name)]
    if culled := named_list(item.name for item in items if any(getattr(item.cycles, name) for name in on)):
        said.append(f"Voxels show {culled} everywhere, also where Culling of Simplify leaves it out: turn that off")
    if cutting := named_list(cut_out_objects(depsgraph.view_layer)):
        said.append(f"Holdouts and shadow catchers {cutting} have no voxels: pictures show what is behind them")
    if behind := scene.background_set:
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


def _is_diced(item: bpy.types.Object, scene: bpy.types.Scene) -> bool:
    """Return whether Cycles subdivides an object by its distance; Blender 4.5 has this among experimental features."""
    last = item.modifiers[-1] if item.modifiers else None
    if last is None or last.type != "SUBSURF" or not last.show_render:
        return False
    trial = getattr(scene.cycles, "feature_set", "") == "EXPERIMENTAL"
    old = trial and getattr(item.cycles, "use_adaptive_subdivision", False)
    return bool(getattr(last, "use_adaptive_subdivision", old))


class _Placed(NamedTuple):
    """Row of `MeshInstances`."""

    name: str
    matrix_world: np.ndarray
    slots: tuple[int, ...]
    values: dict[Asked, tuple[float, ...]]
    links: int


class _Reader:
    """Collector of instances; each mesh and each material once.

    hair, solid: whether the view layer shows strands, and meshes. copies: takes copies of meshes, which are read
    later; None reads them at once. unread_materials: those that cannot be read.
    """

    def __init__(self, frame: float, *, hair: bool, solid: bool, copies: list[bpy.types.Mesh] | None) -> None:
        self._hair, self._solid, self._copies = hair, solid, copies
        self.material_names: dict[str, int] = {}
        self.light_links = LightLinks()
        self.instance_reader = InstanceReader(frame)
        self._meshes: dict[tuple[object, ...], LocalMesh | Strands | MeshToRead | None] = {}
        self._needs: dict[str, tuple[frozenset[str], frozenset[Asked]]] = {}
        self._placed: dict[tuple[object, ...], list[_Placed]] = {}
        self._left_out: dict[str, set[str]] = {}
        self._damaged: dict[str, set[str]] = {}
        self._turned: set[str] = set()
        self._unread, self.unread_materials = Omissions(), Omissions()

    def add(self, instance: bpy.types.DepsgraphObjectInstance) -> None:
        """Read mesh, strands or points, and hair of an instance; unexpected errors leave out its object."""
        name = instance.object.name
        if name not in self._unread:
            with self._unread.leaving_out(name):
                self._add_all(instance)

    def _add_all(self, instance: bpy.types.DepsgraphObjectInstance) -> None:
        item = instance.object
        layers = self._needs_of(item)[0]
        shared = item.data and item.data.as_pointer(), layers  # objects with the same key share a mesh
        if shows_mesh(instance):
            if self._solid:
                self._add(instance, shared, partial(self._mesh_to_read, instance, layers))
        elif shows_itself(instance) and item.type in STRANDS and (self._hair or item.type != "CURVES"):
            self._add(instance, shared, partial(read_strands, item, layers))
        elif shows_itself(instance) and item.type in LEFT_OUT:
            self._left_out.setdefault(item.type, set()).add(item.name)
        owner = instance.instance_object if instance.is_instance else item
        for modifier in hair_modifiers(owner) if self._hair and instance.show_particles else ():
            key = "hair", owner.original.as_pointer(), modifier.name, layers
            self._add(instance, key, partial(read_hair, owner, modifier, layers))

    def _add(
        self,
        instance: bpy.types.DepsgraphObjectInstance,
        key: tuple[object, ...],
        read: Callable[[], LocalMesh | Strands | MeshToRead | None],
    ) -> None:
        """Add a placement of a mesh; a mesh with a new key is read."""
        item = instance.object
        matrix = np.array(instance.matrix_world, np.float64)
        if not np.isfinite(matrix).all():
            self._damaged.setdefault("Objects with positions or scales", set()).add(item.name)
            return
        if key not in self._meshes:
            mesh = read()
            self._meshes[key] = mesh if isinstance(mesh, MeshToRead) else self._checked(mesh, item.name)
        if self._meshes[key] is not None:
            slots = tuple(self._material(slot.material) for slot in item.material_slots)
            placed = _Placed(
                item.name,
                matrix,
                slots or (self._material(None),),
                {asked: self.instance_reader.value(instance, asked) for asked in self._needs_of(item)[1]},
                self.light_links.number(instance),
            )
            self._placed.setdefault(key, []).append(placed)

    def _mesh_to_read(
        self, instance: bpy.types.DepsgraphObjectInstance, layers: frozenset[str]
    ) -> LocalMesh | MeshToRead | None:
        item = instance.object
        # A mesh of geometry nodes or of a curve belongs to no object.
        of_data = instance.is_instance and isinstance(item.data, bpy.types.Mesh)
        how = item.name, item.data.original.name, layers, origin_of_corners(item)
        if self._copies is not None:
            copy = mesh_copy(item, self._copies, of_data=of_data)
            return MeshToRead(copy, *how) if len(copy.polygons) else None
        if of_data:
            return read_local_mesh(MeshToRead(item.data, *how))
        mesh = item.to_mesh()
        try:
            return mesh and read_local_mesh(MeshToRead(mesh, *how))
        finally:
            item.to_mesh_clear()

    def meshes(self) -> Steps[None]:
        """Read the copies, one a step; an unexpected error leaves out all objects with a mesh."""
        for key, mesh in list(self._meshes.items()):
            if isinstance(mesh, MeshToRead):
                yield _READING
                self._meshes[key] = None
                for name in dict.fromkeys(each.name for each in self._placed.get(key, ())):
                    with self._unread.leaving_out(name):
                        self._meshes[key] = self._checked(read_local_mesh(mesh), mesh.name)
                        break

    def _checked(self, mesh: LocalMesh | Strands | None, name: str) -> LocalMesh | Strands | None:
        """Return what was read of an object if anything is left, and note what is wrong with it."""
        if isinstance(mesh, LocalMesh) and mesh.turned:
            self._turned.add(name)
        if mesh is not None and mesh.damaged:
            kind = "Hair and points with coordinates" if isinstance(mesh, Strands) else "Faces with vertices"
            self._damaged.setdefault(kind, set()).add(name)
        return mesh if mesh is not None and len(mesh) else None

    def _needs_of(self, item: bpy.types.Object) -> tuple[frozenset[str], frozenset[Asked]]:
        """Layers and values that the materials of an object request."""
        layers: frozenset[str] = frozenset()
        values: frozenset[Asked] = frozenset()
        for slot in item.material_slots:
            if slot.material:
                key = slot.material.original.name_full
                if key not in self._needs:
                    self._needs[key] = layer_names(slot.material), asked_values(slot.material)
                layers, values = layers | self._needs[key][0], values | self._needs[key][1]
        return layers, values

    def _material(self, material: bpy.types.Material | None) -> int:
        name = material.original.name_full if material else _NO_MATERIAL
        return self.material_names.setdefault(name, len(self.material_names))

    def left_out(self) -> list[str]:
        """Sentences about rendered objects without a surface, and about what cannot be read."""
        damaged = [
            f"{what} {_NOT_FINITE} are left out: repair {named_list(sorted(names))}"
            for what, names in self._damaged.items()
        ]
        if turned := named_list(sorted(self._turned)):
            damaged.append(
                f"Custom normals of {turned} point below the surface, where their light is approximate: reset them "
                "(Mesh > Normals > Reset Vectors)"
            )
        return [
            *self._unread.sentences("Object", "left out"),
            *damaged,
            *(
                f"{LEFT_OUT[kind]} left out, though renders show {named_list(sorted(names))}: convert them to meshes, "
                "or use Refine with Cycles, Passes: Combined"
                for kind, names in self._left_out.items()
            ),
        ]

    def parts(self) -> tuple[tuple[MeshInstances, ...], list[str]]:
        """All MeshInstances, in order of first appearance, and sentences for users."""
        parts = []
        read = {key: mesh for key in self._placed if isinstance(mesh := self._meshes[key], LocalMesh | Strands)}
        meshes, notes = finished(read, {key: len(placed) for key, placed in self._placed.items()})
        for key, mesh in meshes.items():
            placed = self._placed[key]
            width = max(len(each.slots) for each in placed)  # repeat the last slot, as for faces beyond the slots
            slots = [(*each.slots, *(each.slots[-1:] * (width - len(each.slots)))) for each in placed]
            parts.append(
                MeshInstances(
                    mesh=mesh,
                    objects=tuple(each.name for each in placed),
                    matrices_world=np.stack([each.matrix_world for each in placed]),
                    materials=np.array(slots, np.int32),
                    values=_values(placed),
                    links=np.array([each.links for each in placed], np.int32),
                )
            )
        return tuple(parts), notes

    def materials(self) -> Steps[list[MaterialReading]]:
        """Materials in the order of their indices."""
        images, default = ImageReader(), MaterialReading(Material("default"), gloss=DIFFUSE)
        readings = [default] * len(self.material_names)
        for number, name in enumerate(self.material_names):
            yield _READING
            library = {material.name_full: material for material in bpy.data.materials}
            if name in library:
                with self.unread_materials.leaving_out(name):
                    readings[number] = read_material(library[name], images)
        return readings


def _values(placed: Sequence[_Placed]) -> dict[str, np.ndarray]:
    """Values (P, C) float32 of placed objects by layer; zero without a request."""
    widths = {asked: len(value) for each in placed for asked, value in each.values.items()}
    return {
        asked.layer: np.array([each.values.get(asked, (0.0,) * width) for each in placed], np.float32)
        for asked, width in sorted(widths.items())
    }
