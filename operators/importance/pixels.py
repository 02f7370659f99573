# SPDX-License-Identifier: GPL-3.0-or-later
"""Importance of the pixels of a view."""

from __future__ import annotations

import hashlib

import bpy
import numpy as np

from ...patchnet_addon.octree.grid import Grid
from ...patchnet_addon.progress import Steps
from ...patchnet_addon.sampling.frame import Frame
from ...patchnet_addon.sampling.importance import beside_hits, picture_weights
from .image import painted_file, painted_image
from .painted import Importance


def pixel_importance(importance: Importance, scope: str, grid: Grid, frame: Frame) -> Steps[np.ndarray]:
    """(P,) float32 in [0, 1] for the pixels of a frame of the open scene.

    scope: which objects were voxelized. Raises SettingError if what was painted is not there.
    """
    if importance.vertex_group:
        from .vertex_group import PaintedSurface, vertex_group_weights

        surface = PaintedSurface(bpy.context.evaluated_depsgraph_get(), scope, importance.vertex_group)
        weights = yield from vertex_group_weights(surface, grid, frame)
        return beside_hits(frame.picture(weights), frame.picture(frame.hit)).ravel()
    values = painted_image(importance.image) if importance.file is None else painted_file(importance.file)
    return picture_weights(values, frame.height, frame.width)


def importance_key(importance: Importance | None) -> str:
    """What was painted, as a short text: frames that were made with other strokes are not those that would be made."""
    if importance is None:
        return ""
    digest = hashlib.blake2b(digest_size=16)
    if importance.vertex_group:
        from .vertex_group import group_weights

        for item in bpy.data.objects:
            if isinstance(item.data, bpy.types.Mesh) and importance.vertex_group in item.vertex_groups:
                digest.update(item.name_full.encode())
                digest.update(group_weights(item, item.data, importance.vertex_group).data)
    else:
        file = importance.file
        values = painted_image(importance.image) if file is None else painted_file(file)
        digest.update(repr(values.shape).encode() + np.ascontiguousarray(values, np.float32).data)
    return digest.hexdigest()
