# SPDX-License-Identifier: GPL-3.0-or-later
"""Hashes of parts of a scene that is evaluated for a frame, of which keys of results are composed.

`state/scene_state.py` hashes the user's own data.
"""

from __future__ import annotations

import bpy
import numpy as np

from ...patchnet_addon.runtime.omissions import Omissions
from ...patchnet_addon.surface.scene_mesh import SceneMesh
from ..scene_access.own import is_own
from ..state.block_hashes import FILMS, OBJECT_RAYS
from ..state.digest import Digest, names
from ..state.scene_state import settings_of_light

_WITHOUT_VOXELS = frozenset({"LIGHT", "VOLUME"})
_OUTPUT = names("image_settings ffmpeg filepath")  # where renders are written to


def has_films() -> bool:
    """Return whether any image in use is a movie or an image sequence, or a volume a sequence."""
    volumes = any(volume.is_sequence and volume.users for volume in bpy.data.volumes)
    return volumes or any(image.source in FILMS and image.users for image in bpy.data.images)


def surface_hash(source: SceneMesh) -> str:
    """Hash a surface as renders evaluate it: 32 hex digits."""
    digest = Digest()
    digest.text(source.material_names, [sorted(links) for links in source.light_links])
    for part in source.parts:
        mesh = part.mesh
        for name in ("vertices", "triangles", "slots"):
            digest.array(name, getattr(mesh, name))
        digest.array("normals", mesh.corner_normals(0, len(mesh)))
        if mesh.origin:
            digest.text(mesh.origin, mesh.uvs is not None, sorted(mesh.layers))
        else:
            digest.array("uvs", mesh.uvs)
            for name, values in sorted(mesh.layers.items()):
                digest.array(name, values)
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


def lights_hash(depsgraph: bpy.types.Depsgraph) -> str:
    """Hash all that light depends on beside the seen surface, as a graph evaluates it: 32 hex digits.

    That is the world, lamps, materials, settings of renders, and objects that cast shadows but have no voxels. Call
    within `render_geometry`, so that what viewports hide counts.
    """
    digest, unread = Digest(), Omissions()
    scene = depsgraph.scene_eval  # `depsgraph.scene` keeps values of an earlier frame
    digest.block(scene.world)
    digest.text(settings_of_light(scene))
    for instance in depsgraph.object_instances:
        item = instance.object
        if is_own(item):
            continue
        with unread.leaving_out(item.name):
            _add_instance(digest, instance)
    return digest.hexdigest()


def _add_instance(digest: Digest, instance: bpy.types.DepsgraphObjectInstance) -> None:
    item = instance.object
    if item.type != "LIGHT":  # what shadows and reflections show of it may be keyed
        digest.text(*(getattr(item, name) for name in OBJECT_RAYS))
    if not item.hide_render and (item.type in _WITHOUT_VOXELS or not item.visible_camera):
        digest.text(item.name_full)
        digest.array("matrix", np.array(instance.matrix_world, np.float64))
        digest.block(item.data)
        if item.type == "VOLUME":
            digest.file(item.data.grids.frame_filepath)
    for slot in item.material_slots:
        if slot.material is not None and not is_own(slot.material):
            digest.block(slot.material)


def cameras_hash(depsgraph: bpy.types.Depsgraph) -> str:
    """Hash render settings and all cameras, hidden ones too, since pictures are rendered through them."""
    digest, scene = Digest(), depsgraph.scene.original
    digest.text(scene.camera.name_full if scene.camera else None)
    for settings in (scene.cycles, scene.render, depsgraph.view_layer.cycles):
        digest.struct(settings, _OUTPUT)
    for item in scene.objects:
        if item.type == "CAMERA":
            seen = item.evaluated_get(depsgraph)
            digest.text(item.name_full)
            digest.array("matrix", np.array(seen.matrix_world, np.float64))
            digest.block(seen.data)
    return digest.hexdigest()
