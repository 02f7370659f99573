# SPDX-License-Identifier: GPL-3.0-or-later
"""Opening of scenes from files of all kinds that Blender reads, and missing files of a scene.

Blender opens a scene although files are missing: objects of a missing library are left out, and Cycles shows a missing
image in pink.
"""

from __future__ import annotations

import logging
import os
import re
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import IO, Any

import bpy

from ...patchnet_addon.runtime.errors import SceneError
from ...patchnet_addon.runtime.streams import diverted
from ..scene_access.blender_version import tree_in_use
from .layer_names import all_nodes
from .strands import STRANDS

_FROM_FILES = frozenset({"FILE", "MOVIE", "TILED"})  # which file of a sequence is shown, only Cycles knows
_FIND = "put them back, or find them with File > External Data"
# Extension -> import operator.
_IMPORTERS = {
    ".glb": "import_scene.gltf",
    ".gltf": "import_scene.gltf",
    ".obj": "wm.obj_import",
    ".ply": "wm.ply_import",
    ".stl": "wm.stl_import",
    ".fbx": "wm.fbx_import",
    **dict.fromkeys((".usd", ".usda", ".usdc", ".usdz"), "wm.usd_import"),
    ".abc": "wm.alembic_import",
}


def missing_libraries() -> list[str]:
    """Sentences about missing linked libraries, and missing data-blocks of others."""
    absent = {library: _path(library.filepath, library.library) for library in bpy.data.libraries}
    absent = {library: path for library, path in absent.items() if not library.packed_file and not os.path.exists(path)}
    said = []
    if absent:
        said.append(
            f"Linked libraries are missing: {', '.join(absent.values())}; their data is left out: put them back, "
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
    """Sentences about missing libraries, images of these materials and of the world, and caches."""
    users: dict[str, list[str]] = {}
    trees = [(f"material '{material.name}'", tree_in_use(material)) for material in materials]
    if world is not None:
        trees.append((f"world '{world.name}'", world.node_tree))
    for user, tree in trees:
        for path in _missing_images(tree) if tree is not None else ():
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


def _missing_images(tree: bpy.types.NodeTree) -> Iterator[str]:
    """Paths of missing image files of a tree."""
    for node in all_nodes(tree):
        image = getattr(node, "image", None)
        if image is None or image.source not in _FROM_FILES or image.packed_files or image.is_dirty:
            continue
        tiles = image.tiles if image.source == "TILED" else ()
        for name in [image.filepath.replace("<UDIM>", str(tile.number)) for tile in tiles] or [image.filepath]:
            if name and not os.path.exists(path := _path(name, image.library)):
                yield path


def _path(name: str, library: bpy.types.Library | None) -> str:
    return os.path.normpath(bpy.path.abspath(name, library=library))


def open_scene(path: str | Path) -> bpy.types.Scene:
    """Open a .blend file, or import another one into an empty scene; the open scene is closed.

    Raises SceneError if the file is missing, damaged, of an unknown kind, or holds no surface.
    """
    path = Path(path)
    check_scene_file(path)
    extension = path.suffix.lower()
    if is_blend(path):
        _run(path, bpy.ops.wm.open_mainfile, filepath=str(path.absolute()), load_ui=False)
        return bpy.context.scene
    importer = _importer(path, extension)
    bpy.ops.wm.read_homefile(use_empty=True)
    # Importers that would write a line per mesh write warnings only.
    calm = {"loglevel": logging.WARNING} if "loglevel" in importer.get_rna_type().properties else {}
    _run(path, importer, filepath=str(path.absolute()), **calm)
    scene = bpy.context.scene
    scene.name = path.stem  # reports name the scene
    if not any(_has_surface(item) for item in bpy.data.objects):
        raise SceneError(f"Scene file {path} holds no surface that Blender could import: it may be damaged or empty")
    return scene


def is_blend(path: Path) -> bool:
    """Return whether a file name ends in .blend, or in .blend1 to .blend32 as Blender's backups."""
    return re.fullmatch(r"\.blend([1-9]|[12]\d|3[0-2])?", path.suffix.lower()) is not None


def check_scene_file(path: Path) -> None:
    """Raise SceneError if the file does not exist or is a folder."""
    if path.is_dir():
        raise SceneError(f"Scene file {path} is a folder: name a file in it")
    if not path.is_file():
        raise SceneError(f"Scene file {path} does not exist: check its path")


def _has_surface(item: bpy.types.Object) -> bool:
    if item.type == "MESH":
        return len(item.data.polygons) > 0
    return item.type in ("CURVE", "SURFACE", "FONT", "META", *STRANDS)


def _importer(path: Path, extension: str) -> Any:
    """Import operator for an extension; enable the add-on for glTF if necessary."""
    if extension not in _IMPORTERS:
        known = ", ".join([".blend", *_IMPORTERS])
        raise SceneError(f"Scene file {path} has the unknown extension '{extension}': choose one of {known}")
    module, name = _IMPORTERS[extension].split(".")
    if module == "import_scene":
        import addon_utils

        if not addon_utils.check("io_scene_gltf2")[1]:
            addon_utils.enable("io_scene_gltf2", default_set=False)
    operator = getattr(getattr(bpy.ops, module), name)
    try:
        operator.get_rna_type()
    except KeyError:  # Blender can be built without it
        raise SceneError(f"This Blender cannot import {extension} files: convert {path} to .glb or .blend") from None
    return operator


def _run(path: Path, operator: Any, **arguments: object) -> None:
    """Call an operator on a file; importers raise errors of their parsers, and print a lot."""
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        try:
            with diverted(stdout=out, stderr=err):
                result = operator(**arguments)
            failed, report = "FINISHED" not in result, None
        except Exception as cause:  # noqa: BLE001  reported below
            failed, report = True, cause
        printed = [_text(out), _text(err)]
    logging.getLogger("patchnet").debug("Printed while %s was read:\n%s", path, "\n".join(printed))
    if failed:
        reason = _reason(printed[1] if report is None else str(report) or type(report).__name__)
        raise SceneError(f"Scene file {path} cannot be read and may be damaged{reason}") from report


def _text(file: IO[bytes]) -> str:
    file.seek(0)
    return file.read().decode(errors="replace")


def _reason(report: str) -> str:
    """Reason for an operator's failure in brackets, by its report, "" for none.

    An exception reports a traceback, and the place of the call in its last line.
    """
    lines = [line.strip() for line in report.splitlines() if line.strip() and not line.startswith("Location: ")]
    return f" ({lines[-1].removeprefix('Error: ').removesuffix(', see console for detail')})" if lines else ""
