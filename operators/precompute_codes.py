# SPDX-License-Identifier: GPL-3.0-or-later
"""Operator that encodes the finer voxels for the network, once for every corner of every voxel."""

from __future__ import annotations

from dataclasses import replace

import bpy

from ..patchnet_addon.runtime.progress import Steps
from ..patchnet_addon.runtime.quantities import counted
from ..patchnet_addon.runtime.stage_clock import StageClock
from .jobs.job_operator import VoxelJob
from .properties.stages import properties_of
from .schema.values import CODES
from .session import results
from .session.keep import keep
from .settings.job_settings import JobSettings


class PATCHNET_OT_precompute_codes(VoxelJob, bpy.types.Operator):
    """Encode the detail two levels below every voxel, so that the network can rate the pixels of any view"""

    bl_idname = "patchnet.precompute_codes"
    bl_label = "Prepare Look-Ahead"
    __annotations__ = properties_of(CODES)

    def steps(self, context: bpy.types.Context, settings: JobSettings) -> Steps[str]:
        """Load the weights, encode, keep the codes beside the octree."""
        from ..patchnet_addon.network.weights import load_weights
        from .pipeline.stages import encode

        before = results.voxels_of(context.scene)
        clock = StageClock()
        with clock.stage("codes"):
            weights = load_weights(settings.network.weights)
            coded, encoder = yield from encode(before.octree, weights, settings.network)
        made = replace(before, coded=coded, seconds=before.seconds | clock.seconds, encoder=encoder)
        keep(context.scene, results.without_view(made), "codes", settings=settings)
        return f"{counted(coded.coded_count, 'voxel')} with look-ahead, by {encoder}"
