# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluation of refinement strategies over camera tracks of scenes, without Blender (methods 5)."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from ...patchnet_addon.runtime.errors import FileFormatError, PatchNetError
from ...patchnet_addon.runtime.files import read_arrays

WITHOUT = "without-"
"""Names of networks: `station` is trained on this scene alone, `without-station` on the others."""


REPORTS = ("pandas", "matplotlib")


def kept_arrays(path: Path, kind: str, key: str) -> dict[str, np.ndarray] | None:
    """Arrays of a file, mapped into memory; None if it is missing, damaged, or has another key.

    key: hash of all dependencies.
    """
    try:
        arrays, metadata = read_arrays(path, kind)
    except FileFormatError:
        return None
    return arrays if metadata.get("key") == key else None


def require(names: Iterable[str] = REPORTS) -> None:
    """Raise PatchNetError if libraries are missing, by default those of tables and figures."""
    for name in names:
        if find_spec(name) is None:
            raise PatchNetError(f"{name} is missing: install it with `pip install 'patchnet-blender[bench,train]'`")
