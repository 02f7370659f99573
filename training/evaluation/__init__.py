# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluation of refinement strategies over camera tracks of scenes, without Blender (methods 5)."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.util import find_spec

from ...patchnet_addon.runtime.errors import PatchNetError

WITHOUT = "without-"
"""Names of networks: `station` is trained on this scene alone, `without-station` on the others."""


REPORTS = ("pandas", "matplotlib")


def require(names: Iterable[str] = REPORTS) -> None:
    """Raise PatchNetError if libraries are missing, by default those of tables and figures."""
    for name in names:
        if find_spec(name) is None:
            raise PatchNetError(f"{name} is missing: install it with `pip install 'patchnet-blender[bench,train]'`")
