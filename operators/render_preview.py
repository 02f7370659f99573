# SPDX-License-Identifier: GPL-3.0-or-later
"""One camera's preview, where it is wrong, and the picture after the budget is spent there."""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np

from ..patchnet_addon.progress import Steps
from . import results
from .cameras import choose_cameras
from .job.settings import JobSettings
from .job.views import show_view, view
from .job_operator import JobOperator
from .properties import CameraProperties, ViewProperties


class PATCHNET_OT_render_preview(CameraProperties, ViewProperties, JobOperator, bpy.types.Operator):
    """Show the preview, its heatmap and the refined picture of the first camera as Blender images"""

    bl_idname = "patchnet.render_preview"
    bl_label = "Render Preview"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """There must be codes."""
        result = results.result_of(context.scene)
        if result is None or result.coded is None:
            cls.poll_message_set(results.NO_CODES)
            return False
        return super().poll(context)

    def steps(self, context: bpy.types.Context, settings: JobSettings) -> Steps[str]:
        """Trace, score, refine, show."""
        before, coded = results.voxels_of(context.scene), results.codes_of(context.scene)
        bounds = coded.octree.grid.to_world(np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]))
        depsgraph = context.evaluated_depsgraph_get()
        camera = choose_cameras(depsgraph, settings.cameras, settings.size, bounds)[0]
        result = yield from view(coded, camera, settings, compare=False)
        show_view(result)
        share = result.frame.lookahead_share
        results.keep(context.scene, replace(before, lookahead_share=share))
        error, left = result.report["mse_unrefined"], result.report["mse"][settings.strategy]
        return f"{camera.name}: error {error:.2e}, {left:.2e} after refining {settings.budget:.0%} of the active pixels"


CLASSES = (PATCHNET_OT_render_preview,)
