# SPDX-License-Identifier: GPL-3.0-or-later
"""Missing files that a scene names: linked libraries, images of its materials, caches of its meshes.

Blender opens a scene without them and says so on the terminal at most: objects of a missing library are left out, and
Cycles shows a missing image in pink.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator

import bpy

from ..scene_access.blender_version import tree_in_use
from .layer_names import all_nodes

_FROM_FILES = frozenset({"FILE", "SEQUENCE", "MOVIE", "TILED"})
_FIND = "put them back, or find them with File > External Data"


def missing_libraries() -> list[str]:
    """Sentences about linked libraries that are not there, and about what those that are there lack."""
    absent = {library: _path(library.filepath, library.library) for library in bpy.data.libraries}
    absent = {library: path for library, path in absent.items() if not library.packed_file and not os.path.exists(path)}
    said = []
    if absent:
        said.append(
            f"Linked libraries are missing: {', '.join(absent.values())}; what they hold is left out: put them back, "
            "or relocate them in the Outliner under Blender File"
        )
    lacking: dict[str, list[str]] = {}
    for item in bpy.data.user_map() if bpy.data.libraries else ():  # all data-blocks
        if item.is_missing and item.library is not None and item.library not in absent:
            kind = item.bl_rna.name.lower()
            lacking.setdefault(_path(item.library.filepath, item.library.library), []).append(f"{kind} '{item.name}'")
    for path, names in sorted(lacking.items()):
        said.append(f"Library {path} lacks {', '.join(sorted(names))}, which the scene links: it is left out")
    return said


def missing_files(materials: Iterable[bpy.types.Material], world: bpy.types.World | None) -> list[str]:
    """Sentences about libraries, images of these materials and of the world, and caches that are not there."""
    users: dict[str, list[str]] = {}
    for user, tree in _trees(materials, world):
        for path in _missing_images(tree):
            users.setdefault(path, []).append(user)
    said = missing_libraries()
    if users:
        named = ", ".join(f"{path} ({', '.join(sorted(set(names)))})" for path, names in sorted(users.items()))
        said.append(f"Images are missing, which Cycles shows in pink: {named}; {_FIND}")
    caches = sorted(
        path for cache in bpy.data.cache_files if not os.path.exists(path := _path(cache.filepath, cache.library))
    )
    if caches:
        said.append(f"Caches of meshes are missing: {', '.join(caches)}; {_FIND}")
    return said


def _trees(
    materials: Iterable[bpy.types.Material], world: bpy.types.World | None
) -> Iterator[tuple[str, bpy.types.NodeTree]]:
    """List node trees, each with its owner in words."""
    for material in materials:
        if (tree := tree_in_use(material)) is not None:
            yield f"material '{material.name}'", tree
    if world is not None and world.node_tree is not None:
        yield f"world '{world.name}'", world.node_tree


def _missing_images(tree: bpy.types.NodeTree) -> Iterator[str]:
    """Paths of the files that images of a tree are to be read from and that are not there."""
    for node in all_nodes(tree):
        image = getattr(node, "image", None)
        if image is None or image.source not in _FROM_FILES or image.packed_files or image.is_dirty:
            continue
        for name in _files_of(node, image):
            if name and not os.path.exists(path := _path(name, image.library)):
                yield path


def _files_of(node: bpy.types.Node, image: bpy.types.Image) -> list[str]:
    """Files that an image is read from at the present frame."""
    if image.source == "TILED":
        return [image.filepath.replace("<UDIM>", str(tile.number)) for tile in image.tiles]
    if image.source == "SEQUENCE":
        return [_file_of_sequence(image, _number_in_sequence(node.image_user))]
    return [image.filepath]


def _number_in_sequence(user: bpy.types.ImageUser) -> int:
    """Number of a sequence's file at the present frame, as Blender finds it: only evaluated nodes hold it."""
    number = bpy.context.scene.frame_current - user.frame_start + 1
    length = user.frame_duration
    if length > 0 and user.use_cyclic:
        number = number % length or length
    return min(max(number, 0), length) + user.frame_offset


def _file_of_sequence(image: bpy.types.Image, number: int) -> str:
    """Path of a file of a sequence: the last digits of the name are its number."""
    found = re.fullmatch(r"(.*?)(\d+)(\D*)", os.path.basename(image.filepath))
    if found is None:
        return image.filepath
    before, digits, after = found.groups()
    return image.filepath.removesuffix(os.path.basename(image.filepath)) + f"{before}{number:0{len(digits)}d}{after}"


def _path(name: str, library: bpy.types.Library | None) -> str:
    return os.path.normpath(bpy.path.abspath(name, library=library))
