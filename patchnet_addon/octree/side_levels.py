# SPDX-License-Identifier: GPL-3.0-or-later
"""Sides of all levels, bottom-up: what each of a node's faces shows of its children (methods 7.2g).

Along an axis a node has four columns of two children, of which the one in front covers the other. A face shows what of
both is seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..runtime.kernels import device, kernel
from ..surface.chroma_kernels import decode_color, encode_shares
from .octree import LUMINANCE_SCALE
from .sides import FACES

_UNITS = 65535.0  # of a share
_SEEN = 1.0 / 32.0  # of the face that shows most: what shows less does not make a node one with sides
DIFFERS = 0.02  # luminance, of a face to the node's mean: less is not worth its bytes


class LeafSides(NamedTuple):
    """Sides of l leaves before exposure.

    ratio: (l, 6) float16, luminance of what faces each side over the leaf's. share: (l, 6) uint16, area that faces it,
    as seen along its axis, 65535 = a voxel's face. chroma: (l, 6, 2) uint8, or (l, 6, 0) without colour.
    """

    ratio: np.ndarray
    share: np.ndarray
    chroma: np.ndarray


class _Faces(NamedTuple):
    """Faces of the nodes of one level: luminance, 65535 = 1, share seen, and share covered along each axis.

    light, share: (n, 6) uint16. cover: (n, 3) uint16. chroma: (n, 6, 2) uint8, or (n, 6, 0) without colour.
    """

    light: np.ndarray
    share: np.ndarray
    cover: np.ndarray
    chroma: np.ndarray


class SidesOfNodes(NamedTuple):
    """Sides of the nodes that have them, as `Octree` holds them. nodes: (s,) uint32, ascending."""

    nodes: np.ndarray
    light: np.ndarray
    share: np.ndarray
    chroma: np.ndarray


def leaf_sides(faces: np.ndarray, luminance: np.ndarray) -> LeafSides:
    """Sides of leaves of sums (l, 6, 2 or 4), as `LeafSums` holds them, and their luminance (l,) before exposure."""
    area = faces[..., 0]
    own = np.divide(faces[..., 1], area, out=np.zeros_like(area), where=area > 0)
    ratio = np.divide(own, luminance[:, None], out=np.zeros_like(own), where=luminance[:, None] > 0)
    share = np.clip(np.ceil(area * _UNITS), 0, _UNITS).astype(np.uint16)
    chroma = np.empty((len(area), FACES, 2 if faces.shape[2] > 2 else 0), np.uint8)
    if chroma.shape[2]:
        _store_chroma(faces, chroma)
    return LeafSides(np.minimum(ratio, 65504.0).astype(np.float16), share, chroma)


def sides_of_levels(
    masks: Sequence[np.ndarray],
    luminance: Sequence[np.ndarray],
    light: Sequence[np.ndarray],
    leaves: list[LeafSides],
    exposure: float,
) -> SidesOfNodes:
    """Sides of the nodes whose faces differ, of all levels, coarse first.

    By level: child masks (n,), stored luminance (n,) uint16 of nodes, luminance (l,) before exposure and sides of
    leaves; `leaves` is emptied.
    """
    first = np.cumsum([0, *(len(mask) for mask in masks)])
    below = _empty_faces(0, colored=leaves[-1].chroma.shape[2] > 0)
    found = []
    for level in range(len(masks) - 1, -1, -1):
        own = _exposed(leaves.pop(), light[level] * np.float32(exposure))
        faces = _empty_faces(len(masks[level]), colored=below.chroma.shape[2] > 0)
        _compose(masks[level], below, own, faces)
        nodes = np.flatnonzero(_differ(luminance[level], faces))
        found.append(_stored(faces, nodes, int(first[level])))
        below = faces
    return SidesOfNodes(*(np.concatenate(column) for column in zip(*found[::-1], strict=True)))


def _empty_faces(count: int, *, colored: bool) -> _Faces:
    return _Faces(
        np.empty((count, FACES), np.uint16),
        np.empty((count, FACES), np.uint16),
        np.empty((count, 3), np.uint16),
        np.empty((count, FACES, 2 if colored else 0), np.uint8),
    )


def _exposed(leaves: LeafSides, luminance: np.ndarray) -> _Faces:
    """Faces of leaves of a luminance (l,) that is exposed, clamped."""
    light = np.clip(leaves.ratio.astype(np.float32) * luminance[:, None], 0.0, 1.0)
    cover = np.minimum(leaves.share[:, ::2].astype(np.uint32) + leaves.share[:, 1::2], int(_UNITS)).astype(np.uint16)
    return _Faces(np.rint(light * LUMINANCE_SCALE).astype(np.uint16), leaves.share, cover, leaves.chroma)


def _differ(luminance: np.ndarray, faces: _Faces) -> np.ndarray:
    """(n,) bool: nodes of which a face that is seen differs from the mean."""
    seen = faces.share > _SEEN * faces.share.max(axis=1, keepdims=True)
    apart = np.abs(faces.light.astype(np.int32) - luminance[:, None].astype(np.int32)) > DIFFERS * LUMINANCE_SCALE
    return np.asarray((seen & apart).any(axis=1))


def _stored(faces: _Faces, nodes: np.ndarray, first: int) -> SidesOfNodes:
    """Sides of nodes (s,) of a level that begins at the node `first`."""
    light = np.rint(np.sqrt(faces.light[nodes] / np.float32(LUMINANCE_SCALE)) * 255.0).astype(np.uint8)
    share = faces.share[nodes].astype(np.float32)
    largest = np.maximum(share.max(axis=1, keepdims=True, initial=1.0), 1.0)
    share = np.rint(255.0 * share / largest).astype(np.uint8)
    return SidesOfNodes((nodes + first).astype(np.uint32), light, share, faces.chroma[nodes])


@kernel
def _store_chroma(faces, chroma):  # type: ignore[no-untyped-def]
    for leaf in range(len(faces)):
        for face in range(FACES):
            sums = faces[leaf, face]
            chroma[leaf, face, 0], chroma[leaf, face, 1] = encode_shares(float(sums[1]), sums[2], sums[3])


@kernel
def _compose(masks, below, own, faces):  # type: ignore[no-untyped-def]
    """Write the faces of a level: those of its leaves, and what the others show of their children."""
    children = np.empty(8, np.int64)
    child, leaf = 0, 0
    for node in range(len(masks)):
        mask = masks[node]
        if mask == 0:
            faces.light[node], faces.share[node], faces.cover[node] = own.light[leaf], own.share[leaf], own.cover[leaf]
            faces.chroma[node] = own.chroma[leaf]
            leaf += 1
            continue
        for octant in range(8):
            there = mask >> octant & 1
            children[octant] = child if there else -1
            child += there
        for axis in range(3):
            _cover_axis(children, below, faces, node, axis)
            _show_face(children, below, faces, node, axis, 0)
            _show_face(children, below, faces, node, axis, 1)


@device
def _cover_axis(children, below, faces, node, axis):  # type: ignore[no-untyped-def]
    """Write the share of a node that its children cover along an axis."""
    free = 0.0
    for octant in range(8):
        if octant >> axis & 1 == 0:
            front, back = children[octant], children[octant | 1 << axis]
            open_front = 1.0 - below.cover[front, axis] / _UNITS if front >= 0 else 1.0
            free += open_front * (1.0 - below.cover[back, axis] / _UNITS) if back >= 0 else open_front
    faces.cover[node, axis] = np.rint((1.0 - free / 4.0) * _UNITS)


@device
def _show_face(children, below, faces, node, axis, lower):  # type: ignore[no-untyped-def]
    """Write what a face of a node shows of the four columns of its children; lower: it is the lower one of its axis."""
    face = 2 * axis + lower
    total, light, red, green, blue = 0.0, 0.0, 0.0, 0.0, 0.0
    colored = below.chroma.shape[2] > 0
    for octant in range(8):
        if octant >> axis & 1 == lower:
            continue
        free = 1.0
        for child in (children[octant], children[octant ^ 1 << axis]):
            if child < 0:
                continue
            weight = free * below.share[child, face]
            free *= 1.0 - below.cover[child, axis] / _UNITS
            total += weight
            light += weight * below.light[child, face]
            if colored and weight > 0.0:
                hue = below.chroma[child, face]
                r, g, b = decode_color(below.light[child, face] / LUMINANCE_SCALE, hue[0], hue[1])
                red, green, blue = red + weight * r, green + weight * g, blue + weight * b
    # What is seen at all is kept, however little: only shares to each other count in the end.
    faces.share[node, face] = min(np.ceil(total / 4.0), _UNITS)
    faces.light[node, face] = np.rint(light / total) if total > 0.0 else 0
    if colored:
        scale = 1.0 / total if total > 0.0 else 0.0
        hue = encode_shares(light * scale / LUMINANCE_SCALE, red * scale, blue * scale)
        faces.chroma[node, face, 0], faces.chroma[node, face, 1] = hue
