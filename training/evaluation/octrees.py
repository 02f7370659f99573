# SPDX-License-Identifier: GPL-3.0-or-later
"""Octrees of the catalogue's scenes, made once and kept in a folder."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from importlib import metadata
from pathlib import Path

from ...patchnet_addon.runtime.errors import SceneError
from ...patchnet_addon.runtime.file_kinds import OCTREE
from ...patchnet_addon.runtime.replace import replaced_path
from ...patchnet_addon.runtime.source_hash import source_hash
from .scene import OWN_SCENES, Scene

_CODE = "commands.octree"  # with all that it imports


def scene_octree(scene: Scene, folder: Path) -> Path:
    """Octree file of a scene in `folder`, made by `patchnet octree` in a process of its own if it is not there.

    Its name has a hash of the recipe, the scene's file and the code, so that a change of any makes another file.
    Raises SceneError if the file is missing or does not become an octree, OutputError if it cannot be written.
    """
    path = octree_path(scene, folder)
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        with replaced_path(path, OCTREE) as temporary:
            _make(scene, scene.path(), temporary)
    return path


def octree_path(scene: Scene, folder: Path) -> Path:
    """Path of a scene's octree file in `folder`, there or not; raises SceneError if the scene's file is missing."""
    return folder / f"{scene.name}-{_key(scene, scene.path())}.safetensors"


def _key(scene: Scene, source: Path) -> str:
    """16 hex digits over all that the octree depends on: arguments, size and time of the file, code, Blender."""
    stat = None if scene.file in OWN_SCENES else source.stat()
    file = [scene.file] if stat is None else [scene.file, stat.st_size, stat.st_mtime_ns]
    what = json.dumps([scene.arguments(), file, source_hash(_CODE), _blender()])
    return hashlib.sha256(what.encode()).hexdigest()[:16]


def _blender() -> str:
    """Version of Blender as a module, "" where there is none; training does not import it."""
    try:
        return metadata.version("bpy")
    except metadata.PackageNotFoundError:
        return ""


def _make(scene: Scene, source: Path, out: Path) -> None:
    package = __name__.partition(".training")[0]
    command = [sys.executable, "-m", package, "octree", str(source), *scene.arguments(), "--out", str(out)]
    code = subprocess.run(command, stdout=subprocess.DEVNULL, check=False).returncode
    if code:
        how = f"ended with code {code}, see above" if code > 0 else "was killed, perhaps for want of memory"
        raise SceneError(f"Scene {scene.name!r} did not become an octree: `patchnet octree` {how}")
