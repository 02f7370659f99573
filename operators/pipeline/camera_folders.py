# SPDX-License-Identifier: GPL-3.0-or-later
"""Folder names for the pictures of cameras, which may be named alike for a file system."""

from __future__ import annotations

import hashlib
import re
import unicodedata
from collections import Counter
from collections.abc import Iterable, Sequence

import bpy

from ..scene.cameras import AUTO, camera_names, scene_cameras

_MAX_BYTES = 120
_DEVICES = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)", re.IGNORECASE)  # no folder of Windows can have these names


def view_folders(scene: bpy.types.Scene, cameras: Sequence[str]) -> dict[str, str]:
    """Folder of each camera that is looked through, by its name; raises SceneError if there is no such camera."""
    chosen = camera_names(scene, cameras)
    folders = camera_folders(chosen if list(cameras) == [AUTO] else [*scene_cameras(scene), *chosen])
    return {name: folders[name] for name in chosen}


def camera_folders(names: Iterable[str]) -> dict[str, str]:
    """Folder name for each camera's name, all of them different for every file system.

    Letters and digits of the camera's name, other characters as "_". Where that is not the name of one camera alone, by
    whatever case of letters, a hash of the camera's own name follows; so names do not depend on the order of cameras,
    and with all cameras of a scene given not on which of them are looked through.
    """
    names = list(dict.fromkeys(names))
    for digits in (4, 8, 16, 32):
        found = _with_digits(names, digits)
        if len({_folded(folder) for folder in found.values()}) == len(names):
            break
    return found


def _with_digits(names: list[str], digits: int) -> dict[str, str]:
    plain = {name: _plain(name) for name in names}
    owners = Counter(_folded(folder) for folder in plain.values())
    unchanged = Counter(_folded(name) for name, folder in plain.items() if name == folder)
    found = {}
    for name, folder in plain.items():
        key = _folded(folder)
        alone = owners[key] == 1 or (name == folder and unchanged[key] == 1)
        if not alone or _DEVICES.fullmatch(folder) or len(folder.encode(errors="surrogatepass")) > _MAX_BYTES:
            digest = hashlib.blake2b(name.encode(errors="surrogatepass")).hexdigest()[:digits]
            folder = f"{_shortened(folder)}-{digest}"
        found[name] = folder
    return found


def _plain(name: str) -> str:
    return bpy.path.clean_name(name) or "camera"


def _folded(folder: str) -> str:
    """Folded name, the same for names that some file system takes for one: of other case, or composed otherwise."""
    return unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", folder).casefold())


def _shortened(folder: str) -> str:
    return folder.encode(errors="surrogatepass")[:_MAX_BYTES].decode(errors="ignore")
