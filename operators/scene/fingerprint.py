# SPDX-License-Identifier: GPL-3.0-or-later
"""Fingerprint of a scene: a hash for each part that results depend on; keys of results combine such hashes.

Parts are those of the scene evaluated for a frame. `state/scene_state.py` tracks changes of the user's own data.
"""

from __future__ import annotations

from collections.abc import Iterator

import bpy
import numpy as np

from ..scene_access.own import is_own
from ..state.digest import Digest, names, origin_of_corners
from .local_mesh import LocalMesh
from .read import read_scene
from .scene_mesh import SceneMesh

_OUTPUT = names("image_settings ffmpeg filepath")  # where renders are written to
_OBJECT_SKIPPED = names(
    """bound_box dimensions mode name select children children_recursive parent users_collection users_scene data
    vertex_groups pose motion_path use_mesh_mirror_x use_mesh_mirror_y use_mesh_mirror_z lineart
    add_rest_position_attribute show_name show_axis show_in_front show_wire show_bounds show_all_edges
    show_texture_space show_transparent show_only_shape_key use_shape_key_edit_mode active_shape_key_index
    active_shape_key active_material active_material_index particle_systems hide_select display display_type
    display_bounds_type is_instancer is_from_instancer is_from_set"""
)
# Transforms are hashed for each instance. Of objects that are only instanced, these properties differ even between two
# evaluations.
_PLACE = names(
    """matrix_world matrix_local matrix_basis matrix_parent_inverse location rotation_euler rotation_quaternion
    rotation_axis_angle rotation_mode scale delta_location delta_rotation_euler delta_rotation_quaternion delta_scale"""
)
_FILMS = frozenset({"SEQUENCE", "MOVIE"})


def composed(*parts: object) -> str:
    """Key (32 hex digits) of parts of a fingerprint and other values."""
    digest = Digest()
    digest.text(*parts)
    return digest.hexdigest()


def has_films() -> bool:
    """Return whether any image in use is a movie or an image sequence."""
    return any(image.source in _FILMS and image.users for image in bpy.data.images)


def surface_hash(source: SceneMesh) -> str:
    """Hash a surface as renders evaluate it: 32 hex digits."""
    digest = Digest()
    digest.text(source.material_names, [sorted(links) for links in source.light_links])
    for part in source.parts:
        _add_mesh(digest, part.mesh)
        for name in ("matrices_world", "materials", "links"):
            digest.array(name, getattr(part, name))
        for name, values in part.values.items():
            digest.array(name, values)
    return digest.hexdigest()


def world_hash(world: bpy.types.World | None) -> str:
    """Hash a world and all that it refers to: 32 hex digits."""
    digest = Digest()
    digest.block(world)
    return digest.hexdigest()


class SceneFingerprint:
    """Parts of a scene's fingerprint, for a frame: each 32 hex digits, computed on demand."""

    def __init__(self, depsgraph: bpy.types.Depsgraph) -> None:
        self._depsgraph = depsgraph

    def surface(self, scope: str) -> str:
        """Surface of the objects of a scope. Raises as `read_scene` does."""
        return surface_hash(read_scene(self._depsgraph, scope))

    def scene(self) -> str:
        """All that emits, shadows or reflects light, baked or not, the frame, and render settings.

        Not covered: results of drivers and geometry nodes of objects that are disabled in viewports yet rendered (their
        inputs are covered), single files of image sequences, and children of particle hair beyond their settings.
        """
        digest, scene, layer = Digest(), self._depsgraph.scene, self._depsgraph.view_layer
        digest.text(scene.frame_current_final, layer.use_sky, layer.use_strand, layer.use_volumes)
        digest.block(scene.world)
        for settings in (scene.cycles, scene.render, layer.cycles):
            digest.struct(settings, _OUTPUT)
        for name in ("material_override", "world_override"):
            digest.block(getattr(layer, name, None))
        for item, data in self._objects(digest):
            _add_object(digest, item, data)
            _add_materials(digest, item)
        return digest.hexdigest()

    def _objects(self, digest: Digest) -> Iterator[tuple[bpy.types.Object, bpy.types.ID | None]]:
        """Rendered objects, each once, with their evaluated data; instances are hashed on the way."""
        met: set[tuple[str, int]] = set()
        for instance in self._depsgraph.object_instances:
            item = instance.object
            if item.hide_render or is_own(item):
                continue
            digest.text(item.name_full, instance.show_self, instance.random_id)
            digest.array("matrix", np.array(instance.matrix_world, np.float64))
            key = item.name_full, item.data.as_pointer() if item.data else 0
            if key not in met:
                met.add(key)
                # Not the temporary object of an instance: Blender leaks settings that are read from it.
                lasting = item.original.evaluated_get(self._depsgraph) if instance.is_instance else item
                yield lasting, item.data
        evaluated = {name for name, _ in met}
        for item in self._depsgraph.scene.original.objects:  # disabled in viewports, yet rendered
            if item.name_full not in evaluated and not item.hide_render and not is_own(item):
                digest.text(tuple(map(tuple, item.matrix_world)))
                yield item, item.data

    def lights(self) -> str:
        """World, lamps and the materials of shown objects."""
        digest = Digest()
        digest.block(self._depsgraph.scene_eval.world)  # `depsgraph.scene` keeps values of an earlier frame
        for instance in self._depsgraph.object_instances:
            item = instance.object
            if item.type == "LIGHT" and not item.hide_render:
                digest.text(item.name_full)
                digest.array("matrix", np.array(instance.matrix_world, np.float64))
                digest.block(item.data)
            _add_materials(digest, item)
        return digest.hexdigest()

    def cameras(self) -> str:
        """Film and all cameras, hidden ones too, since pictures are rendered through them."""
        digest, scene = Digest(), self._depsgraph.scene.original
        digest.text(scene.camera.name_full if scene.camera else None, scene.render.film_transparent)
        for item in scene.objects:
            if item.type == "CAMERA":
                seen = item.evaluated_get(self._depsgraph)
                digest.text(item.name_full)
                digest.array("matrix", np.array(seen.matrix_world, np.float64))
                digest.block(seen.data)
        return digest.hexdigest()


def _add_mesh(digest: Digest, mesh: LocalMesh) -> None:
    """Add a mesh of the surface without its transforms."""
    for name in ("vertices", "triangles", "slots"):
        digest.array(name, getattr(mesh, name))
    digest.array("normals", mesh.corner_normals(0, len(mesh)))
    if mesh.origin:
        digest.text(mesh.origin, mesh.uvs is not None, sorted(mesh.layers))
    else:
        digest.array("uvs", mesh.uvs)
        for name, values in sorted(mesh.layers.items()):
            digest.array(name, values)


def _add_object(digest: Digest, item: bpy.types.Object, data: bpy.types.ID | None) -> None:
    """Add an object without its transform and materials; data: its evaluated data."""
    digest.struct(item, _OBJECT_SKIPPED | _PLACE)
    for system in item.particle_systems:
        digest.text(len(system.particles))
        digest.particles(system)
    if data is not None and (origin := origin_of_corners(item)):
        digest.text(type(data).__name__, data.name_full, origin)
        if isinstance(data, bpy.types.Mesh):
            digest.geometry(data, corners=False)
    else:
        digest.block(data)
    if isinstance(data, bpy.types.Volume):
        digest.file(bpy.path.abspath(data.filepath, library=data.library))


def _add_materials(digest: Digest, item: bpy.types.Object) -> None:
    """Add the materials that an object shows."""
    for slot in item.material_slots:
        if slot.material is not None and not is_own(slot.material):
            digest.block(slot.material)
