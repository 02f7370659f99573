# SPDX-License-Identifier: GPL-3.0-or-later
"""Key of a bake: a hash of everything that determines its pages, so that equal keys mean equal bits."""

from __future__ import annotations

from functools import cache

import bpy

from ....patchnet_addon.lightmap.charts import Charts
from ....patchnet_addon.runtime.source_hash import source_hash
from ...scene.fingerprint import composed, surface_hash
from ...scene.scene_mesh import SceneMesh
from ...state.digest import Digest

_CHART_ARRAYS = (
    "page", "x", "y", "log_width", "log_height", "kind", "origin", "along", "page_samples", "page_size"
)  # fmt: skip
_code_hash = cache(lambda: source_hash("operators.cycles.bake.bake"))  # and of what it imports


def bake_key(
    scene: str, source: SceneMesh, charts: Charts, samples: int, seed: int, switches: tuple[object, ...] = ()
) -> str:
    """32 hex digits over surface, charts, samples, and `scene`, that part of the scene's fingerprint.

    switches: whatever else determines the pages.
    """
    layout = Digest()
    layout.text(charts.texel_world, charts.page_side, charts.page_count)
    for name in _CHART_ARRAYS:
        layout.array(name, getattr(charts, name))
    blender = bpy.app.version_string, bpy.app.build_hash, _devices()
    parts = scene, surface_hash(source), layout.hexdigest()
    return composed(_code_hash(), *blender, *parts, samples, seed, switches)


def _devices() -> tuple[str, ...]:
    """Devices that Cycles could compute on: processors differ in their last bits."""
    try:
        import _cycles  # type: ignore[import-not-found]
    except ImportError:
        return ()
    return tuple(str(device[:2]) for device in _cycles.available_devices("NONE"))
