# SPDX-License-Identifier: GPL-3.0-or-later
"""Reference render in two halves of different seeds, whose difference tells the noise of their mean."""

from __future__ import annotations

import bpy

from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.tracing.camera import Camera
from .camera_render import Reference, render_reference
from .daylight import light_of_bake


def render_halves(context: bpy.types.Context, camera: Camera, samples: int) -> Steps[tuple[Reference, Reference]]:
    """Two renders of half the samples each, in the light that was baked; raises SceneError as `render_reference`."""
    yield Progress(0, 2, "Cycles")
    with light_of_bake(context):
        first = render_reference(context, camera, samples // 2, 1)
    yield Progress(1, 2, "Cycles")
    with light_of_bake(context):
        second = render_reference(context, camera, samples // 2, 2)
    yield Progress(2, 2, "Cycles")
    return first, second
