# SPDX-License-Identifier: GPL-3.0-or-later
"""Temporary data-blocks, only there while a job runs, and the temporary folder of this Blender process.

Blender never writes such data-blocks into a file that is saved meanwhile.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TypeVar

import bpy

from ...patchnet_addon.runtime.unfinished import goes_with_process

Block = TypeVar("Block", bound=bpy.types.ID)

_COLLECTIONS = {
    "Camera": "cameras", "Collection": "collections", "Image": "images", "Material": "materials", "Mesh": "meshes",
    "Object": "objects", "Scene": "scenes", "ShaderNodeTree": "node_groups", "SunLight": "lights", "World": "worlds",
}  # fmt: skip
_FOLDER = re.compile(r"blender_\w{6}")  # without one of its own, Blender names the folder of all temporary files


@contextmanager
def temporary(block: Block) -> Iterator[Block]:
    """Create a data-block that is removed after the block of code, unless opening another file has done so."""
    block.is_runtime_data = True
    collection = getattr(bpy.data, _COLLECTIONS[type(block).__name__])
    try:
        yield block
    finally:
        with suppress(ReferenceError):
            collection.remove(block)


@contextmanager
def scene_copy(scene: bpy.types.Scene) -> Iterator[bpy.types.Scene]:
    """Copy a scene, with the same objects and settings of its own: some, once changed, cannot be unset again.

    What is set in it and linked to it is the job's alone. Afterwards the view layers of all scenes are up to date.
    """
    with temporary(scene.copy()) as copy:
        yield copy
    sync_view_layers()


def sync_view_layers() -> None:
    """Bring all view layers up to date with their collections, which removing a data-block leaves undone until needed.

    Before the next frame of an animation, Blender 5.2 copies the scene for its render's own graph. From a layer that is
    not up to date it copies objects that point nowhere, and crashes (`deg_check_base_in_depsgraph`).
    """
    for scene in bpy.data.scenes:
        for layer in scene.view_layers:
            layer.objects.active  # noqa: B018  reading it is what brings the layer up to date


def session_folder_goes() -> None:
    """Let Blender's temporary folder go with a process that is ended at once, as Blender lets it go with itself."""
    folder = Path(bpy.app.tempdir)
    if _FOLDER.fullmatch(folder.name):
        goes_with_process(folder)
