# SPDX-License-Identifier: GPL-3.0-or-later
"""Versions of the programs that computed a result, for results that are published."""

from __future__ import annotations

import os
import platform
import sys
from typing import Any

import bpy

from ...patchnet_addon.runtime.versions import installed_version, own_version


def versions() -> dict[str, Any]:
    """Versions of PatchNet, Blender, Python and the libraries that compute; None for one that is not there."""
    return {
        "patchnet": own_version(),
        "blender": bpy.app.version_string,
        "python": platform.python_version(),
        **{name: _installed(name) for name in ("numpy", "numba", "torch")},
    }


def machine() -> dict[str, Any]:
    """Kind of machine, as far as timings depend on it."""
    return {"system": sys.platform, "processor": platform.machine(), "cores": os.cpu_count()}


def _installed(name: str) -> str | None:
    """Version of an imported module, else of an installed package: Blender's own NumPy says it only in the module."""
    if name in sys.modules:
        return str(sys.modules[name].__version__)
    return installed_version(name)
