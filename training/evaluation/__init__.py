# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluation of refinement strategies over camera tracks of scenes, without Blender (methods 5)."""

from __future__ import annotations

from importlib.util import find_spec

from ...patchnet_addon.runtime.errors import PatchNetError

WITHOUT = "without-"
"""Names of networks: `station` is trained on this scene alone, `without-station` on the others."""


def require_reports() -> None:
    """Raise PatchNetError if libraries for tables and figures are missing."""
    for name in ("pandas", "matplotlib"):
        if find_spec(name) is None:
            raise PatchNetError(f"Tables and figures need {name}: install patchnet-blender[bench]")
