# SPDX-License-Identifier: GPL-3.0-or-later
"""Sidebar tab PatchNet: its panels from top to bottom."""

from . import main, stages

CLASSES = (
    main.PATCHNET_PT_main,
    stages.PATCHNET_PT_octree,
    stages.PATCHNET_PT_light,
    stages.PATCHNET_PT_animation,
    stages.PATCHNET_PT_network,
    stages.PATCHNET_PT_preview,
    stages.PATCHNET_PT_importance,
    stages.PATCHNET_PT_compare,
    stages.PATCHNET_PT_cycles_refine,
    main.PATCHNET_PT_export,
    main.PATCHNET_PT_statistics,
)
