# SPDX-License-Identifier: GPL-3.0-or-later
"""numba and llvmlite of this extension, for the engine process where another extension brings others.

Blender installs the wheels of all enabled extensions into one folder: of a package that two of them bring, the newest
version. Kernels are tested with the versions of this extension's wheels only, so the engine takes these from the cache
folder then.
"""

from __future__ import annotations

import hashlib
import logging
import os
import shutil
import sys
import zipfile
from pathlib import Path
from typing import NamedTuple

from ..runtime.cache_folder import WHEELS, remove_unused, user_cache_folder
from ..runtime.owned_folder import owned_folder, remove_left_over
from ..runtime.versions import installed_version

_FOLDER = Path(__file__).parents[2] / "wheels"  # beside the code of an installed zip
_NAMES = "wheels.txt"  # in a folder of unpacked wheels, once all are
_PYTHON = "cp{}{}".format(*sys.version_info)
_ANY = "[0-9a-f]{16}"


class OtherVersion(NamedTuple):
    """Package in Blender's folder of another version than this extension's; installed is None if there is none."""

    package: str
    installed: str | None
    own: str


def other_versions() -> list[OtherVersion]:
    """Packages of own wheels that this process would import in another version; none without wheels."""
    own = [(name, version) for name, version, *_ in (wheel.name.split("-") for wheel in _wheels())]
    found = [OtherVersion(name, installed_version(name), version) for name, version in own]
    return [each for each in found if each.installed != each.own]


def other_versions_text(*, computes_with_own: bool) -> str:
    """Sentences about other versions, and what computes then; "" if there are none."""
    return ". ".join(_sentence(each, computes_with_own) for each in other_versions())


def own_wheels_folder() -> Path:
    """Folder of unpacked wheels in the cache folder, whether it is there or not."""
    names = "\n".join(wheel.name for wheel in _wheels())
    return user_cache_folder() / WHEELS / hashlib.sha256(names.encode()).hexdigest()[:16]


def own_path() -> list[str]:
    """Folder to put first in the path of imports, with all wheels unpacked; [] if there are no other versions."""
    if not other_versions():
        return []
    folder = own_wheels_folder()
    try:
        _unpack(folder)
    except OSError as cause:
        logging.getLogger("patchnet").warning(
            "%s cannot be unpacked into %s (%s), so kernels may fail: make room, or name another folder in the "
            "preferences or in PATCHNET_CACHE",
            " and ".join(each.package for each in other_versions()), folder, cause.strerror or cause,
        )  # fmt: skip
        return []
    return [str(folder)]


def _wheels() -> list[Path]:
    """Wheels of this extension for this Python, by name."""
    return sorted(_FOLDER.glob(f"*-{_PYTHON}-*.whl"))


def _sentence(other: OtherVersion, computes_with_own: bool) -> str:
    package, installed, own = other
    brought = f"Another extension brings {package} {installed} for all" if installed else f"Blender has no {package}"
    if computes_with_own:
        return f"{brought}: PatchNet computes with its own {own}"
    return f"{brought}, PatchNet needs {own}: its kernels may fail; disable the other extension, or allow the process"


def _unpack(folder: Path) -> None:
    """Unpack the wheels unless they are; raises OSError."""
    if (folder / _NAMES).is_file():
        os.utime(folder)  # marks its last use
        return
    folder.parent.mkdir(parents=True, exist_ok=True)
    remove_left_over(folder.parent, _ANY)
    remove_unused(folder.parent)
    with owned_folder(folder) as unpacked:
        for wheel in _wheels():
            with zipfile.ZipFile(wheel) as archive:
                archive.extractall(unpacked)
        (unpacked / _NAMES).write_text("".join(f"{wheel.name}\n" for wheel in _wheels()), encoding="utf-8")
        if not (folder / _NAMES).is_file():  # another process may be faster
            shutil.rmtree(folder, ignore_errors=True)  # what is left of a deletion
            os.replace(unpacked, folder)
