# SPDX-License-Identifier: GPL-3.0-or-later
"""Sidebar tab PatchNet: its panels from top to bottom."""

from .main import PATCHNET_PT_export, PATCHNET_PT_main, PATCHNET_PT_statistics
from .stages import (
    PATCHNET_PT_animation,
    PATCHNET_PT_compare,
    PATCHNET_PT_cycles_refine,
    PATCHNET_PT_importance,
    PATCHNET_PT_light,
    PATCHNET_PT_network,
    PATCHNET_PT_octree,
    PATCHNET_PT_preview,
)

CLASSES = (
    PATCHNET_PT_main,
    PATCHNET_PT_octree,
    PATCHNET_PT_light,
    PATCHNET_PT_animation,
    PATCHNET_PT_network,
    PATCHNET_PT_preview,
    PATCHNET_PT_importance,
    PATCHNET_PT_compare,
    PATCHNET_PT_cycles_refine,
    PATCHNET_PT_export,
    PATCHNET_PT_statistics,
)
