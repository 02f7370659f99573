# SPDX-License-Identifier: GPL-3.0-or-later
"""Poll functions of operators: their requirements, and messages for unmet ones."""

from __future__ import annotations

from typing import Any

import bpy

from ..session import results
from ..session.octree_cache import result_or_kept
from .job_operator import JobOperator


class VoxelJob(JobOperator):
    """Job on the voxels of the scene."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Require voxels."""
        return has_voxels(cls, context) and super().poll(context)


class CodesJob(JobOperator):
    """Job on the codes of the scene."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Require codes."""
        result = result_or_kept(context.scene)
        return _unless(cls, result is None or result.coded is None, results.NO_CODES) and super().poll(context)


def has_voxels(operator: Any, context: bpy.types.Context) -> bool:
    """Return whether there are voxels; else set the poll message."""
    return _unless(operator, result_or_kept(context.scene) is None, results.NO_VOXELS)


def in_object_mode(operator: Any, context: bpy.types.Context, what: str) -> bool:
    """Return whether Object Mode is active, which `what` needs; else set the poll message."""
    return _unless(operator, context.mode != "OBJECT", f"{what} in Object Mode only: leave the present mode")


def no_job_runs(operator: Any) -> bool:
    """Return whether no job runs in a window; else set the poll message."""
    running = JobOperator.running
    return _unless(operator, bool(running), f"{running} is running: wait for it, or press Esc over the window")


def _unless(operator: Any, hindered: bool, sentence: str) -> bool:
    if hindered:
        operator.poll_message_set(sentence)
    return not hindered
