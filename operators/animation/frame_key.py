# SPDX-License-Identifier: GPL-3.0-or-later
"""Keys of frames: hashes that tell whether a frame that was made is what would be made now."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import bpy

from ...patchnet_addon.runtime.source_hash import source_hash
from ..scene.fingerprint import SceneFingerprint, composed
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
    count. What the fingerprint does not see is not seen here. Raises as `read_scene` does.
    """
    surface = SceneFingerprint(context.evaluated_depsgraph_get()).surface(scope)
    scene = SceneFingerprint(context.evaluated_depsgraph_get())  # reading may have evaluated anew
    return composed(code_hash(), bpy.app.version_string, settings, surface, scene.scene(), scene.cameras())


def file_key(scene_file: Path, settings: str, frame: int) -> str:
    """32 hex digits over settings, frame, and size and time of a .blend file that is open and of all that it names.

    Quicker than `content_key`: equal keys mean an equal frame, others mean nothing.
    """
    digest = Digest()
    digest.text(code_hash(), bpy.app.version_string, settings, frame)
    for path in (str(scene_file.absolute()), *sorted(bpy.utils.blend_paths(absolute=True))):
        digest.file(path)
    return digest.hexdigest()


@cache
def code_hash() -> str:
    """Hash of the code that makes results: another version does not mix its results with those of this one."""
    return source_hash(*_CODE)
