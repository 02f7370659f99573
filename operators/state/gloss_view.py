# SPDX-License-Identifier: GPL-3.0-or-later
"""Hash of the place that gloss is seen from: where the active camera stands, by the user's own data.

Cycles bakes what a perspective camera sees from its place, whichever way it looks, and an orthographic one from its
direction, wherever it stands.
"""

from __future__ import annotations

import bpy

from .digest import Digest

GLOSS_MOVED = "the camera that gloss is seen from moved"
_NOWHERE = "no camera"


def place_of_gloss(scene: bpy.types.Scene) -> str:
    """32 hex digits over what says where the active camera of a scene stands; other words without one.

    What Blender computes from it, the world's matrix, is not known right after an undo. Objects that the camera follows
    are part of the surface, but for other cameras.
    """
    item = scene.camera
    if item is None or item.type != "CAMERA":
        return _NOWHERE
    digest, local = Digest(), item.matrix_basis
    from_afar = item.data.type == "ORTHO"
    digest.text(from_afar, tuple(local.col[2].xyz.normalized() if from_afar else local.translation))
    for constraint in item.constraints:
        digest.struct(constraint, depth=2)
    while item.parent is not None:
        digest.text(item.parent.name_full, item.parent_type, item.parent_bone, _rows(item.matrix_parent_inverse))
        item = item.parent
        digest.text(_rows(item.matrix_basis))
    return digest.hexdigest()


def _rows(matrix: object) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in matrix)  # type: ignore[attr-defined]
