# SPDX-License-Identifier: GPL-3.0-or-later
"""Keys of frames: hashes that tell whether a frame that was made is what would be made now."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import bpy
import numpy as np

from ...patchnet_addon.runtime.source_hash import source_hash
from ..cycles.bake.bake_key import add_scene, add_surface
from ..scene.read import read_scene
from ..state.digest import Digest

# What makes results, and what it imports; a worker is a program of its own.
_CODE = (
    "operators.animation.animation", "operators.animation.frame_maker",
    "operators.pipeline.run", "operators.voxelize_objects", "operators.bake_light", "operators.precompute_codes",
    "operators.load_octree", "patchnet_addon.network.torch_worker",
)  # fmt: skip


def content_key(context: bpy.types.Context, scope: str, settings: str) -> str:
    """32 hex digits over settings and all of the scene, as it is at its present frame, that a frame's files depend on.

    It sees changes that were not saved, and no change where only other frames differ. Which machine computes does not
    count. What `bake_key` does not see is not seen here. Raises as `read_scene` does.
    """
    source = read_scene(context.evaluated_depsgraph_get(), scope)
    digest = _begun(settings)
    add_surface(digest, source)
    depsgraph = context.evaluated_depsgraph_get()
    add_scene(digest, depsgraph)
    _add_cameras(digest, depsgraph)
    return digest.hexdigest()


def file_key(scene_file: Path, settings: str, frame: int) -> str:
    """32 hex digits over settings, frame, and size and time of a .blend file that is open and of all that it names.

    Quicker than `content_key`: equal keys mean an equal frame, others mean nothing.
    """
    digest = _begun(settings)
    digest.text(frame)
    for path in (str(scene_file.absolute()), *sorted(bpy.utils.blend_paths(absolute=True))):
        digest.file(path)
    return digest.hexdigest()


def _begun(settings: str) -> Digest:
    digest = Digest()
    digest.text(code_hash(), bpy.app.version_string, settings)
    return digest


@cache
def code_hash() -> str:
    """Hash of the code that makes results: another version does not mix its results with those of this one."""
    return source_hash(*_CODE)


def _add_cameras(digest: Digest, depsgraph: bpy.types.Depsgraph) -> None:
    """Add film and all cameras, also those that are hidden: pictures are made through them nevertheless."""
    scene = depsgraph.scene.original
    digest.text(scene.camera.name_full if scene.camera else None, scene.render.film_transparent)
    for item in scene.objects:
        if item.type == "CAMERA":
            seen = item.evaluated_get(depsgraph)
            digest.text(item.name_full)
            digest.array("matrix", np.array(seen.matrix_world, np.float64))
            digest.block(seen.data)
