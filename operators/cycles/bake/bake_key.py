# SPDX-License-Identifier: GPL-3.0-or-later
"""Key of a bake: a hash of everything that determines its pages, so that equal keys mean equal bits."""

from __future__ import annotations

from functools import cache

import bpy
import numpy as np

from ....patchnet_addon.lightmap.charts import Charts
from ....patchnet_addon.runtime.source_hash import source_hash
from ...scene.local_mesh import LocalMesh
from ...scene.scene_mesh import SceneMesh
from ...scene_access.own import is_own
from ...state.digest import Digest, names
from ...state.unsteady import origin_of_corners

_CHART_ARRAYS = (
    "page", "x", "y", "log_width", "log_height", "kind", "origin", "along", "page_samples", "page_size"
)  # fmt: skip
_CODE = ("operators.cycles.bake.bake",)  # and what it imports


def bake_key(
    scene: str, source: SceneMesh, charts: Charts, samples: int, seed: int, switches: tuple[object, ...] = ()
) -> str:
    """32 hex digits over surface, charts, samples, and all of the scene that a bake could show, by its `scene_key`.

    switches: whatever else determines the pages.
    """
    digest = Digest()
    digest.text(code_hash(), bpy.app.version_string, bpy.app.build_hash, scene, samples, seed, switches, _devices())
    digest.text(charts.texel_world, charts.page_side, charts.page_count)
    for name in _CHART_ARRAYS:
        digest.array(name, getattr(charts, name))
    add_surface(digest, source)
    return digest.hexdigest()


def scene_key(depsgraph: bpy.types.Depsgraph) -> str:
    """32 hex digits over what shines, shadows and reflects, whether it is baked or not, and how Cycles renders it.

    Not seen are: drivers and geometry nodes of objects that are disabled in viewports yet rendered (what they depend
    on counts, what they make of it does not), single files of image sequences, and the children of particle hair beyond
    their settings.
    """
    digest = Digest()
    add_scene(digest, depsgraph)
    return digest.hexdigest()


@cache
def code_hash() -> str:
    """Hash of the code that bakes: another version never takes pages of this one."""
    return source_hash(*_CODE)


def _devices() -> tuple[str, ...]:
    """Devices that Cycles could compute on: processors differ in their last bits."""
    try:
        import _cycles  # type: ignore[import-not-found]
    except ImportError:
        return ()
    return tuple(str(device[:2]) for device in _cycles.available_devices("NONE"))


def add_surface(digest: Digest, source: SceneMesh) -> None:
    """Add the surface that is baked, as renders evaluate it."""
    digest.text(source.material_names, [sorted(links) for links in source.light_links])
    for part in source.parts:
        add_mesh(digest, part.mesh)
        for name in ("matrices_world", "materials", "links"):
            digest.array(name, getattr(part, name))
        for name, values in part.values.items():
            digest.array(name, values)


def add_mesh(digest: Digest, mesh: LocalMesh) -> None:
    """Add a mesh of the surface, wherever it is placed."""
    for name in ("vertices", "triangles", "slots"):
        digest.array(name, getattr(mesh, name))
    digest.array("normals", mesh.corner_normals(0, len(mesh)))
    if mesh.origin:
        digest.text(mesh.origin, mesh.uvs is not None, sorted(mesh.layers))
    else:
        digest.array("uvs", mesh.uvs)
        for name, values in sorted(mesh.layers.items()):
            digest.array(name, values)


def add_scene(digest: Digest, depsgraph: bpy.types.Depsgraph) -> None:
    """Add all that shines, shadows and reflects, whether it is baked or not, and how Cycles renders it."""
    scene = depsgraph.scene
    digest.text(scene.frame_current_final)
    add_world(digest, depsgraph)
    met: set[tuple[str, int]] = set()
    for instance in depsgraph.object_instances:
        item = instance.object
        if item.hide_render or is_own(item):
            continue
        digest.text(item.name_full, instance.show_self, instance.random_id)
        digest.array("matrix", np.array(instance.matrix_world, np.float64))
        key = item.name_full, item.data.as_pointer() if item.data else 0
        if key not in met:
            met.add(key)
            # Not what stands for an instance: Blender makes that for a moment, and leaks settings that are asked of it.
            add_object(digest, item.original.evaluated_get(depsgraph) if instance.is_instance else item, item.data)
            add_materials(digest, item)
    evaluated = {name for name, _ in met}
    for item in scene.original.objects:  # not in viewports, yet in renders
        if item.name_full not in evaluated and not item.hide_render and not is_own(item):
            digest.text(tuple(map(tuple, item.matrix_world)))
            add_object(digest, item, item.data)
            add_materials(digest, item)


def add_world(digest: Digest, depsgraph: bpy.types.Depsgraph) -> None:
    """Add the world and how Cycles renders the scene."""
    scene, layer = depsgraph.scene, depsgraph.view_layer
    digest.block(scene.world)
    for settings in (scene.cycles, scene.render, layer.cycles):
        digest.struct(settings, _OUTPUT)
    for name in ("material_override", "world_override"):
        digest.block(getattr(layer, name, None))


_OUTPUT = names("image_settings ffmpeg filepath")  # where renders are written to
_OBJECT_SKIPPED = names(
    """bound_box dimensions mode name select children children_recursive parent users_collection users_scene data
    vertex_groups pose motion_path use_mesh_mirror_x use_mesh_mirror_y use_mesh_mirror_z lineart
    add_rest_position_attribute show_name show_axis show_in_front show_wire show_bounds show_all_edges
    show_texture_space show_transparent show_only_shape_key use_shape_key_edit_mode active_shape_key_index
    active_shape_key active_material active_material_index particle_systems hide_select display display_type
    display_bounds_type is_instancer is_from_instancer is_from_set"""
)
# Where an object stands is hashed for each of its instances. Of what is only instanced these are not even the same in
# two evaluations.
_PLACE = names(
    """matrix_world matrix_local matrix_basis matrix_parent_inverse location rotation_euler rotation_quaternion
    rotation_axis_angle rotation_mode scale delta_location delta_rotation_euler delta_rotation_quaternion delta_scale"""
)


def add_object(digest: Digest, item: bpy.types.Object, data: bpy.types.ID | None) -> None:
    """Add an object without its place and its materials; `data` is what is shown for it."""
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


def add_materials(digest: Digest, item: bpy.types.Object) -> None:
    """Add the materials that an object shows."""
    for slot in item.material_slots:
        digest.block(slot.material)
