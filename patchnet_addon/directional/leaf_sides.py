# SPDX-License-Identifier: GPL-3.0-or-later
"""Sides of leaves: what the surface in a leaf shows on each of its faces (methods 7.2i).

Sums are floats, which take half the memory of whole numbers; an octree stores 8 bits of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..cells.leaf_box_kernels import covered_steps, ends_of_axis
from ..cells.leaf_boxes import STEPS
from ..runtime.kernels import device, kernel
from ..surface.chroma_kernels import encode_chroma
from ..surface.side_kernels import face_towards
from ..surface.sides import BACK, FACES, FRONT

SHARE_UNITS = 65535.0  # of a share
DIFFERS = 0.004  # luminance difference of a face from the mean that is worth its bytes
_TURNED = 0.01  # of the area that faces both ways: above rounding
# Weight of a fragment's light by its place, from the far end of a voxel to the near one in 32nds, where a voxel holds
# several layers: what lies behind is hidden, as the layer under a slab is.
_IN_FRONT = np.exp(32.0 * np.arange(-15, 16) / 32.0)

FACE_SUM = np.dtype([("area", "f4"), ("front", "f4"), ("front_light", "f4"), ("light", "f4")])
FACE_HUE = np.dtype([("red", "f4"), ("blue", "f4")])


class FaceSums(NamedTuple):
    """Sums over the fragments of R leaves that point to a face, over a voxel's face, by side and face.

    sums: (R, 2, 6) FACE_SUM: projected area, the same weighted by its place, that times luminance, and area times
    luminance. hues: (R, 2, 6) FACE_HUE, area times red and blue; (0, 2, 6) without colour.
    """

    sums: np.ndarray
    hues: np.ndarray


class LeafSides(NamedTuple):
    """Sides of a level's leaves with differing sides; all others have their mean on each.

    leaf: (k,) int64, indices of the leaves, ascending. light: (k, 6) float32, luminance of the surface that points to
    each face, before exposure. share: (k, 6) uint16, its projected area, 65535 = a voxel's face; odd where that is
    mostly backs of triangles. chroma: (k, 6, 2) uint8, or (k, 6, 0) without colour.
    """

    leaf: np.ndarray
    light: np.ndarray
    share: np.ndarray
    chroma: np.ndarray


def leaf_sides(
    faces: FaceSums, row: np.ndarray, boxes: np.ndarray, luminance: np.ndarray, normal: np.ndarray, face_world: float
) -> LeafSides:
    """Sides of leaves with rows (l,) of `faces`, which are changed, boxes (l, 3), and luminance (l,).

    normal: (l, 3), area * normal of fronts. face_world: area of a voxel's face.
    """
    is_back, found = _hide_backs(faces), np.empty(len(row), np.bool_)
    _find_different(faces, row, boxes, luminance, normal, 1.0 / face_world, found)
    leaf = np.flatnonzero(found)
    own, light = row[leaf], np.empty((len(leaf), FACES), np.float32)
    _write_light(faces, row, boxes, leaf, light)
    area = faces.sums["area"][own, FRONT]
    share = np.clip(2.0 * np.ceil(area * (SHARE_UNITS / 2.0)), 0, SHARE_UNITS - 1).astype(np.uint16) | is_back[own]
    chroma = np.empty((len(leaf), FACES, 0), np.uint8)
    if len(faces.hues):
        red_blue = faces.hues[own, FRONT].view(np.float32).reshape(-1, 2)
        chroma = encode_chroma(faces.sums["light"][own, FRONT].ravel(), red_blue).reshape(-1, FACES, 2)
    return LeafSides(leaf, light, share, chroma)


def no_sides(*, colored: bool) -> LeafSides:
    """Empty sides, for leaves without any."""
    chroma = np.empty((0, FACES, 2 if colored else 0), np.uint8)
    return LeafSides(np.empty(0, np.int64), np.empty((0, FACES), np.float32), np.empty((0, FACES), np.uint16), chroma)


def joined_sides(parts: Sequence[LeafSides], counts: Sequence[int]) -> LeafSides:
    """Sides of the leaves of several parts, in order, with `counts` leaves each."""
    first = np.cumsum([0, *counts[:-1]])
    shifted = [part._replace(leaf=part.leaf + start) for part, start in zip(parts, first, strict=True)]
    return LeafSides(*(np.concatenate(column) for column in zip(*shifted, strict=True)))


@device
def add_to_faces(faces, leaf, side, share, normal, box, light):
    """Add a side of a fragment in a packed box to the three faces of its leaf that it points to.

    share: its area over a voxel's face. normal: (3,) of its front. light: luminance, red and blue.
    """
    for axis in range(3):
        along = (share if side == FRONT else -share) * normal[axis]
        face = face_towards(axis, along)
        area, place = abs(along), ends_of_axis(box, axis)
        front = area * _IN_FRONT[place if along > 0.0 else len(_IN_FRONT) - 1 - place]
        sums = faces.sums[leaf, side, face]
        sums.area += np.float32(area)
        sums.front += np.float32(front)
        sums.front_light += np.float32(front * light[0])
        sums.light += np.float32(area * light[0])
        if len(faces.hues):
            hues = faces.hues[leaf, side, face]
            hues.red += np.float32(area * light[1])
            hues.blue += np.float32(area * light[2])


@kernel
def _hide_backs(faces):
    """Add the unoccluded backs that point to a face to the fronts there; (R, 6) uint16, 1 if most are backs.

    On each face of a thin solid with an opening, as much back as front points to the face, and lies behind it.
    """
    is_back = np.zeros((len(faces.sums), FACES), np.uint16)
    for leaf in range(len(faces.sums)):
        for face in range(FACES):
            front, back = faces.sums[leaf, FRONT, face], faces.sums[leaf, BACK, face]
            if back.area > front.area:
                free = (back.area - front.area) / back.area
                is_back[leaf, face] = back.area - front.area > front.area
                front.area += free * back.area
                front.front += free * back.front
                front.front_light += free * back.front_light
                front.light += free * back.light
                if len(faces.hues):
                    hue, back_hue = faces.hues[leaf, FRONT, face], faces.hues[leaf, BACK, face]
                    hue.red += free * back_hue.red
                    hue.blue += free * back_hue.blue
    return is_back


@device
def _shown(sums, covered):
    """Luminance that a face shows: as far as layers hide others, the front one's.

    A single surface projects to at most the face of its box, of `covered` steps. If a layer that covers a share c of it
    lies before one that covers all, the areas are 1 + c, and c^2 mixes the mean by area and the front layer to the
    light that is seen.
    """
    layers = sums.area * STEPS**2 / covered
    hidden = min(max(layers - 1.0, 0.0), 1.0) ** 2
    mean, front = sums.light / sums.area, sums.front_light / sums.front
    return np.float32(mean + hidden * (front - mean))


@kernel
def _find_different(faces, row, boxes, luminance, normal, per_face, found):
    """Find leaves with a face that differs from the mean by more than a share of it; exposure does not change this.

    Also those whose light is that of their backs, whose mean normal has the opposite direction.
    """
    for leaf in range(len(row)):
        covered = covered_steps(boxes, leaf)
        found[leaf] = False
        for axis in range(3):
            upper, lower = faces.sums[row[leaf], FRONT, 2 * axis], faces.sums[row[leaf], FRONT, 2 * axis + 1]
            for sums in (upper, lower):
                if sums.area > 0.0:
                    apart = abs(_shown(sums, covered[axis]) - luminance[leaf])
                    found[leaf] |= apart > luminance[leaf] * DIFFERS
            turned = abs(upper.area - lower.area - normal[leaf, axis] * per_face)
            found[leaf] |= turned > _TURNED * (upper.area + lower.area)


@kernel
def _write_light(faces, row, boxes, leaf, light):
    """Write what the faces of leaves (k,) show, black where no surface points to them."""
    for i in range(len(leaf)):
        covered = covered_steps(boxes, leaf[i])
        for face in range(FACES):
            sums = faces.sums[row[leaf[i]], FRONT, face]
            light[i, face] = _shown(sums, covered[face // 2]) if sums.area > 0.0 else np.float32(0)
