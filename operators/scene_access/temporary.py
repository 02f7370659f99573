# SPDX-License-Identifier: GPL-3.0-or-later
"""Temporary data-blocks, only there while a job runs, and the temporary folder of this Blender process.

Blender never writes such data-blocks into a file that is saved meanwhile. But it keeps them in a step of undo that is
made meanwhile, as ordinary ones: where they come back, they go.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

import bpy
from bpy.app.handlers import persistent

from ...patchnet_addon.runtime.unfinished import goes_with_process
from .overrides import put_back_when_saved
from .own import quiet

Block = TypeVar("Block", bound=bpy.types.ID)

_COLLECTIONS = {
    "Camera": "cameras", "Collection": "collections", "Image": "images", "Material": "materials", "Mesh": "meshes",
    "Object": "objects", "Scene": "scenes", "ShaderNodeTree": "node_groups", "SunLight": "lights", "World": "worlds",
}  # fmt: skip
_MARK = "patchnet_temporary"  # custom property
_FOLDER = re.compile(r"blender_\w{6}")  # without one of its own, Blender names the folder of all temporary files


@contextmanager
def temporary(block: Block, instead_of: bpy.types.ID | None = None) -> Iterator[Block]:
    """Create a data-block that is removed after the block of code, unless opening another file has done so.

    instead_of: what users of the block get back where a step of undo has it.
    """
    block.is_runtime_data = True
    block[_MARK] = instead_of or True
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
    try:
        with temporary(scene.copy()) as copy:
            yield copy
    finally:
        sync_view_layers()


@contextmanager
def new_render_results_go() -> Iterator[None]:
    """Remove and never save a render result that was not there before the block: Blender keeps what it rendered."""
    before = {image.name_full for image in bpy.data.images}

    def new() -> list[bpy.types.Image]:
        return [image for image in bpy.data.images if image.type == "RENDER_RESULT" and image.name_full not in before]

    def leave_out() -> None:
        for image in new():
            image.is_runtime_data = True

    try:
        with put_back_when_saved(leave_out, lambda: None):
            yield
    finally:
        for image in new():
            bpy.data.images.remove(image)


def sync_view_layers() -> None:
    """Bring all view layers up to date with their collections, which removing a data-block leaves undone until needed.

    Before the next frame of an animation, Blender 5.2 copies the scene for its render's own graph. From a layer that is
    not up to date it copies objects that point nowhere, and crashes (`deg_check_base_in_depsgraph`).
    """
    for scene in bpy.data.scenes:
        for layer in scene.view_layers:
            layer.objects.active  # noqa: B018  reading it is what brings the layer up to date


@persistent
def _leftovers_go(*_: object) -> None:
    """Remove what a step of undo or quit.blend has of a job, which has been ended by then."""
    with quiet():
        for name in _COLLECTIONS.values():
            collection = getattr(bpy.data, name)
            for block in [block for block in collection if _MARK in block]:
                if isinstance(block[_MARK], bpy.types.ID):
                    block.user_remap(block[_MARK])
                collection.remove(block)
        sync_view_layers()


def _handlers() -> tuple[list[Any], ...]:
    lists = bpy.app.handlers
    return lists.undo_post, lists.redo_post, lists.load_post


def register() -> None:
    """Listen to what brings data-blocks back."""
    for handlers in _handlers():
        handlers.append(_leftovers_go)


def unregister() -> None:
    """Stop listening."""
    for handlers in _handlers():
        handlers.remove(_leftovers_go)


def session_folder_goes() -> None:
    """Let Blender's temporary folder go with a process that is ended at once, as Blender lets it go with itself."""
    folder = Path(bpy.app.tempdir)
    if _FOLDER.fullmatch(folder.name):
        goes_with_process(folder)
