# SPDX-License-Identifier: GPL-3.0-or-later
"""Views of a viewport that no camera had when light was baked: their light may be coarse."""

from __future__ import annotations

from dataclasses import replace

import bpy

from ...patchnet_addon.export.fine_light import FINE_LIGHT
from ...patchnet_addon.runtime.errors import SceneError
from ..pipeline.lit_octree import cameras_text
from ..scene.cameras import camera_name, tracing_camera
from ..session.scene_result import SceneResult

COARSE = (
    "coarse light beyond what the cameras saw: choose Light Cells: Everywhere, or look through a camera and press "
    "Preview Selection"
)


def is_coarse(context: bpy.types.Context, result: SceneResult) -> bool:
    """Return whether a viewport may show coarse light: it looks through none of the cameras of the bake."""
    if result.octree.provenance.get(FINE_LIGHT, 1.0) >= 1.0:
        return False
    scene, space = context.scene, context.space_data
    item = space.camera if space.use_local_camera else scene.camera
    if context.region_data.view_perspective != "CAMERA" or item is None:
        return True
    try:
        camera = tracing_camera(item, scene, tuple(scene.patchnet.size))
    except SceneError:
        return True
    # The text of one camera is part of the text of all.
    return cameras_text([replace(camera, name=camera_name(scene, item))])[1:-1] not in result.made_by.get("seen", "")
