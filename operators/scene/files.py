# SPDX-License-Identifier: GPL-3.0-or-later
"""Open a scene from a file of any kind that Blender reads."""

from __future__ import annotations

import logging
import re
import tempfile
from pathlib import Path
from typing import IO, Any

import bpy

from ...patchnet_addon.runtime.errors import SceneError
from ...patchnet_addon.runtime.interrupt import interrupts_wait
from ...patchnet_addon.runtime.streams import diverted
from .strands import STRANDS

# Extension -> names of import operators, the first one that exists is used, and the add-on that brings them.
_IMPORTERS: dict[str, tuple[tuple[str, ...], str]] = {
    ".glb": (("import_scene.gltf",), "io_scene_gltf2"),
    ".gltf": (("import_scene.gltf",), "io_scene_gltf2"),
    ".obj": (("wm.obj_import",), ""),
    ".ply": (("wm.ply_import",), ""),
    ".stl": (("wm.stl_import",), ""),
    ".fbx": (("wm.fbx_import", "import_scene.fbx"), "io_scene_fbx"),
    ".usd": (("wm.usd_import",), ""),
    ".usda": (("wm.usd_import",), ""),
    ".usdc": (("wm.usd_import",), ""),
    ".usdz": (("wm.usd_import",), ""),
    ".abc": (("wm.alembic_import",), ""),
}


def open_scene(path: str | Path) -> bpy.types.Scene:
    """Open a .blend file, or import any other one into an empty scene; what was open before is closed.

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
    # Importers that write a line per mesh are asked for warnings only.
    calm = {"loglevel": logging.WARNING} if "loglevel" in importer.get_rna_type().properties else {}
    _run(path, importer, filepath=str(path.absolute()), **calm)
    scene = bpy.context.scene
    scene.name = path.stem  # reports name the scene
    if not any(_has_surface(item) for item in bpy.data.objects):
        raise SceneError(f"Scene file {path} holds no surface that Blender could import: it may be damaged or empty")
    return scene


def is_blend(path: Path) -> bool:
    """Return whether a file is a .blend by its name, or one of Blender's backups of it, .blend1 to .blend32."""
    return re.fullmatch(r"\.blend([1-9]|[12]\d|3[0-2])?", path.suffix.lower()) is not None


def check_scene_file(path: Path) -> None:
    """Raise SceneError if there is no such file, or a folder in its place."""
    if path.is_dir():
        raise SceneError(f"Scene file {path} is a folder: name a file in it")
    if not path.is_file():
        raise SceneError(f"Scene file {path} does not exist: check its path")


def _has_surface(item: bpy.types.Object) -> bool:
    if item.type == "MESH":
        return len(item.data.polygons) > 0
    return item.type in ("CURVE", "SURFACE", "FONT", "META", *STRANDS)


def _importer(path: Path, extension: str) -> Any:
    """Import operator for an extension, its add-on enabled if need be."""
    if extension not in _IMPORTERS:
        known = ", ".join([".blend", *_IMPORTERS])
        raise SceneError(f"Scene file {path} has the unknown extension '{extension}': choose one of {known}")
    names, addon = _IMPORTERS[extension]
    operator = _first_operator(names)
    if operator is None and addon:
        import addon_utils

        addon_utils.enable(addon, default_set=False)
        operator = _first_operator(names)
    if operator is None:
        raise SceneError(f"This Blender cannot import {extension} files: convert {path} to .glb or .blend")
    return operator


def _first_operator(names: tuple[str, ...]) -> Any | None:
    for name in names:
        module, function = name.split(".")
        operator = getattr(getattr(bpy.ops, module), function)
        try:
            operator.get_rna_type()
        except KeyError:
            continue
        return operator
    return None


def _run(path: Path, operator: Any, **arguments: object) -> None:
    """Call an operator on a file; importers raise whatever their parser stumbled on, and print a lot."""
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        try:
            with interrupts_wait(), diverted(stdout=out, stderr=err):
                result = operator(**arguments)
            failed, report = "FINISHED" not in result, None
        except Exception as cause:  # noqa: BLE001  it is told below
            failed, report = True, cause
        printed = [_text(out), _text(err)]
    logging.getLogger("patchnet").debug("Printed while %s was read:\n%s", path, "\n".join(printed))
    if failed:
        reason = _reason(printed[1] if report is None else str(report) or type(report).__name__)
        raise SceneError(f"Scene file {path} cannot be read, it may be damaged{reason}") from report


def _text(file: IO[bytes]) -> str:
    file.seek(0)
    return file.read().decode(errors="replace")


def _reason(report: str) -> str:
    """Reason for an operator's failure in brackets, by its report, "" for none.

    That of an exception is a traceback, and the place of the call in a last line.
    """
    lines = [line.strip() for line in report.splitlines() if line.strip() and not line.startswith("Location: ")]
    return f" ({lines[-1].removeprefix('Error: ').removesuffix(', see console for detail')})" if lines else ""
