# SPDX-License-Identifier: GPL-3.0-or-later
"""Temporary data-blocks, which exist only while a job runs, and the temporary folder of this Blender process.

Blender does not save them into files. But it keeps them in undo steps as ordinary data-blocks; when undo restores them,
they are removed.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TypeVar

import bpy
from bpy.app.handlers import persistent

from .overrides import put_back_when_saved
from .own import quiet

Block = TypeVar("Block", bound=bpy.types.ID)

_COLLECTIONS = {
    "Camera": "cameras", "Collection": "collections", "Image": "images", "Material": "materials", "Mesh": "meshes",
    "Object": "objects", "Scene": "scenes", "ShaderNodeTree": "node_groups", "SunLight": "lights", "World": "worlds",
}  # fmt: skip
_MARK = "patchnet_temporary"  # custom property
_FOLDER = re.compile(r"blender_\w{6}")  # otherwise Blender uses the system's folder for temporary files


@contextmanager
def temporary(block: Block, instead_of: bpy.types.ID | None = None) -> Iterator[Block]:
    """Remove a new data-block after the block of code, unless opening another file has done so.

    instead_of: replaces the data-block if undo restores it.
    """
    _mark(block, instead_of or True)
    collection = getattr(bpy.data, _COLLECTIONS[type(block).__name__])
    try:
        yield block
    finally:
        with suppress(ReferenceError):
            collection.remove(block)


@contextmanager
def temporary_meshes() -> Iterator[list[bpy.types.Mesh]]:
    """List to which `mesh_copy` adds; removes its meshes after the block of code, unless another file was opened."""
    meshes: list[bpy.types.Mesh] = []
    try:
        yield meshes
    finally:
        with suppress(ReferenceError):
            bpy.data.batch_remove(meshes)  # one by one, each takes a millisecond


def mesh_copy(item: bpy.types.Object, meshes: list[bpy.types.Mesh], *, of_data: bool) -> bpy.types.Mesh:
    """Copy the mesh of an evaluated object, which shares its arrays with it until either changes.

    meshes: of `temporary_meshes`. of_data: copy its data as they are; else as `to_mesh`, which counts Edit Mode.
    """
    mesh = item.data.copy() if of_data else bpy.data.meshes.new_from_object(item)
    meshes.append(mesh)
    _mark(mesh, True)
    return mesh


def _mark(block: bpy.types.ID, value: bpy.types.ID | bool) -> None:
    block.is_runtime_data = True
    block[_MARK] = value


@contextmanager
def scene_copy(scene: bpy.types.Scene) -> Iterator[bpy.types.Scene]:
    """Copy a scene with the same objects and separate settings, since some settings cannot be unset once changed.

    Afterwards the view layers of all scenes are up to date.
    """
    try:
        with temporary(scene.copy()) as copy:
            yield copy
    finally:
        sync_view_layers()


@contextmanager
def new_render_results_go() -> Iterator[None]:
    """Remove render results that the block creates, and exclude them from saved files."""
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
    """Synchronise all view layers with their collections, which Blender delays after removing a data-block.

    Before the next frame of an animation, Blender 5.2 copies the scene for the graph of its render. From an outdated
    layer it copies dangling pointers to objects, and crashes (`deg_check_base_in_depsgraph`).
    """
    for scene in bpy.data.scenes:
        for layer in scene.view_layers:
            layer.objects.active  # noqa: B018  reading it synchronises the layer


@persistent
def _leftovers_go(*_: object) -> None:
    """Remove data-blocks of an ended job that an undo step or quit.blend restored."""
    with quiet():
        for name in _COLLECTIONS.values():
            collection = getattr(bpy.data, name)
            for block in [block for block in collection if _MARK in block]:
                if isinstance(block[_MARK], bpy.types.ID):
                    block.user_remap(block[_MARK])
                collection.remove(block)
        sync_view_layers()


HANDLERS = tuple((name, _leftovers_go) for name in ("undo_post", "redo_post", "load_post"))


def remove_session_folder() -> None:
    """Remove Blender's temporary folder in a process that ends without Blender's own cleanup."""
    folder = Path(bpy.app.tempdir)
    if _FOLDER.fullmatch(folder.name):
        shutil.rmtree(folder, ignore_errors=True)
