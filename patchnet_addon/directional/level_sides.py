# SPDX-License-Identifier: GPL-3.0-or-later
"""Sides of all levels, bottom-up: the visible light of a node's children on each of its faces (methods 7.2i).

Along an axis a node has four columns of two children, of which the front one occludes the other. A face combines the
visible parts of both.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import repeat
from typing import NamedTuple

import numpy as np

from ..cells.morton import POPCOUNT
from ..cells.scales import LUMINANCE_SCALE, NORMAL_SCALE
from ..runtime.kernels import device, kernel
from ..runtime.threads import executor, thread_count
from ..surface.chroma_kernels import decode_color, encode_shares
from ..surface.sides import FACES
from .leaf_sides import DIFFERS, SHARE_UNITS, LeafSides

_BYTE = 255.0
_SEEN = 1.0 / 32.0  # of the largest visible share: smaller ones do not give a node sides
# Bytes per node: nodes that differ most have sides, so that an octree grows by no more than this; in small octrees, all
# that differ have.
_MOST_BYTES, _FREE = 2.9, 1 << 16
_RARE = 3  # bits by which the difference of a back that is rarely visible counts less
_COLUMN_LEVEL = 8  # level whose columns of voxels have one lowest surface
_PIECE = 1 << 16  # nodes whose children's faces a thread holds at a time


class LevelNodes(NamedTuple):
    """Nodes of one level as `Octree` holds them; chroma: (n, 0) without colour."""

    mask: np.ndarray
    area_world: np.ndarray
    normal: np.ndarray
    luminance: np.ndarray
    chroma: np.ndarray


class Level(NamedTuple):
    """Nodes of a level, area of a voxel's face, and the sides of its leaves."""

    nodes: LevelNodes
    face_world: float
    sides: LeafSides


class _Faces(NamedTuple):
    """Faces of n nodes: luminance, 65535 = 1, visible share, and covered share along each axis.

    light, share: (n, 6) uint16, shares odd where mostly backs are visible. cover: (n, 3) uint16. chroma: (n, 6, 2)
    uint8, or (n, 6, 0) without colour.
    """

    light: np.ndarray
    share: np.ndarray
    cover: np.ndarray
    chroma: np.ndarray


class SidesOfNodes(NamedTuple):
    """Sides of s nodes as `Octree` holds them: nodes (s,) uint32, ascending, light, share, chroma.

    difference: (s,) uint16, of visible faces from the mean.
    """

    difference: np.ndarray
    nodes: np.ndarray
    light: np.ndarray
    share: np.ndarray
    chroma: np.ndarray


def sides_of_levels(levels: Sequence[Level], exposure: float) -> SidesOfNodes:
    """Sides of the nodes whose faces differ most, of all levels, coarse first.

    Faces of the finest level, the largest, are computed in pieces, together with their parents'.
    """
    first = np.cumsum([0, *(len(level.nodes.mask) for level in levels)])
    lowest = _lowest([level.nodes.mask for level in levels])
    depth = len(levels) - 1
    place = [np.flatnonzero(level.nodes.mask == 0)[level.sides.leaf] for level in levels]
    kept = _faces(levels[depth], place[depth], slice(0, 0), None, exposure)
    found: list[list[SidesOfNodes]] = [[] for _ in levels]

    def piece(level: int, here: slice, children: slice) -> tuple[_Faces, list[SidesOfNodes]]:
        mine = []
        if level + 1 == depth:
            below = _faces(levels[depth], place[depth], children, None, exposure)
            mine.append(_differing(levels[depth], children, below, lowest[depth], int(first[depth])))
        else:
            below = _Faces(*(values[children] for values in kept))
        faces = _faces(levels[level], place[level], here, below, exposure)
        return faces, [_differing(levels[level], here, faces, lowest[level], int(first[level])), *mine]

    with executor(thread_count()) as pool:
        for level in range(depth - 1, -1, -1):
            mask = levels[level].nodes.mask
            starts = np.arange(0, len(mask), _PIECE)
            ends = np.append(starts[1:], len(mask))
            child = np.cumsum([0, *np.add.reduceat(POPCOUNT[mask], starts, dtype=np.int64)]).tolist()
            made = list(pool.map(piece, repeat(level), map(slice, starts, ends), map(slice, child, child[1:])))
            kept = _Faces(*(np.concatenate(column) for column in zip(*(faces for faces, _ in made), strict=True)))
            for _, differing in made:
                for of_level, rows in zip(found[level:], differing, strict=False):
                    of_level.append(rows)
    columns = zip(*(rows for of_level in found for rows in of_level), strict=True)
    sides = SidesOfNodes(*(np.concatenate(column) for column in columns))
    node_bytes = sum(column[:1].nbytes for column in sides[1:]) or 1
    return _most_different(sides, max(_FREE, int(_MOST_BYTES / node_bytes * first[-1])))


def _faces(level: Level, place: np.ndarray, here: slice, below: _Faces | None, exposure: float) -> _Faces:
    """Faces of nodes of a level, whose children have those of `below`; None if all are leaves.

    place: (k,) of the leaves with sides among the level's nodes.
    """
    count, hues = here.stop - here.start, level.nodes.chroma.shape[1]
    faces = _Faces(
        np.empty((count, FACES), np.uint16),
        np.empty((count, FACES), np.uint16),
        np.empty((count, 3), np.uint16),
        np.empty((count, FACES, hues), np.uint8),
    )
    nodes = LevelNodes(*(column[here] for column in level.nodes))
    _write_faces(nodes, 1.0 / level.face_world, faces if below is None else below, faces)
    sides = level.sides
    first, last = np.searchsorted(place, (here.start, here.stop))
    row, own = place[first:last] - here.start, slice(first, last)
    share = sides.share[own]
    faces.light[row] = np.rint(np.clip(sides.light[own] * exposure, 0.0, 1.0) * LUMINANCE_SCALE)
    faces.share[row], faces.chroma[row] = share, sides.chroma[own]
    faces.cover[row] = np.minimum(share[:, ::2].astype(np.uint32) + share[:, 1::2], int(SHARE_UNITS))
    return faces


def _lowest(masks: Sequence[np.ndarray]) -> list[np.ndarray]:
    """For the nodes of each level, (n,) bool: they, or their ancestor of `_COLUMN_LEVEL`, have none below."""
    place: np.ndarray = np.zeros((1, 3), np.uint16)
    found: list[np.ndarray] = []
    for level in range(len(masks)):
        if level > _COLUMN_LEVEL:
            found.append(np.repeat(found[-1], POPCOUNT[masks[level - 1]]))
            continue
        if level:
            parent, octant = np.nonzero(masks[level - 1][:, None] >> np.arange(8, dtype=np.uint8) & 1)
            place = 2 * place[parent] + (octant[:, None] >> np.arange(3) & 1).astype(np.uint16)
        column, height = place[:, 0].astype(np.int64) << level | place[:, 1], place[:, 2]
        floor = np.full(1 << 2 * level, height.max(), np.uint16)
        np.minimum.at(floor, column, height)
        found.append(height <= floor[column] + (level == _COLUMN_LEVEL))  # a slope has two in a column
    return found


def _differing(level: Level, here: slice, faces: _Faces, lowest: np.ndarray, first: int) -> SidesOfNodes:
    """Sides of nodes whose visible faces differ enough from the mean.

    lowest: (n,) bool, of the level's nodes; first: its first node.
    """
    difference = np.empty(len(faces.share), np.uint16)
    _write_difference(faces, level.nodes.luminance[here], lowest[here], difference)
    row = np.flatnonzero(difference > DIFFERS * LUMINANCE_SCALE)
    light = np.rint(np.sqrt(faces.light[row] / np.float32(LUMINANCE_SCALE)) * _BYTE).astype(np.uint8)
    share, is_back = faces.share[row].astype(np.float32), faces.share[row] & 1
    is_leaf = (level.nodes.mask[here][row] == 0)[:, None]  # a ray hits its surface, by its box
    share /= np.where(is_leaf, np.maximum(share.max(axis=1, keepdims=True, initial=0.0), 1.0), SHARE_UNITS)
    nodes = (row + here.start + first).astype(np.uint32)
    share_bytes = np.rint(_BYTE * share).astype(np.uint8) & 254 | is_back.astype(np.uint8)
    return SidesOfNodes(difference[row], nodes, light, share_bytes, faces.chroma[row])


def _most_different(sides: SidesOfNodes, most: int) -> SidesOfNodes:
    """Sides of at most `most` nodes, those that differ most."""
    count = len(sides.nodes)
    if count <= most:
        return sides
    kept = np.sort(np.argpartition(sides.difference, count - most)[-most:])
    return SidesOfNodes(*(column[kept] for column in sides))


@kernel
def _write_difference(faces, luminance, lowest, difference):
    """Write the largest difference of visible faces of nodes from their luminance (n,).

    A back counts less where it is black, or that of a lowest node, as of a ground.
    """
    for node in range(len(difference)):
        least = _SEEN * faces.share[node].max()
        difference[node] = 0
        for face in range(FACES):
            apart = abs(np.int64(faces.light[node, face]) - np.int64(luminance[node]))
            if faces.share[node, face] & 1 and (lowest[node] or faces.light[node, face] == 0):
                apart >>= _RARE
            if faces.share[node, face] > least and apart > difference[node]:
                difference[node] = apart


@kernel
def _write_faces(nodes, per_face, below, faces):
    """Write the faces of nodes: of leaves as of flat surfaces, of others from the visible parts of their children."""
    children = np.empty(8, np.int64)
    child = 0
    for node in range(len(nodes.mask)):
        mask = nodes.mask[node]
        if mask == 0:
            for axis in range(3):
                along = nodes.normal[node, axis] / NORMAL_SCALE
                share = min(
                    2.0 * np.ceil(nodes.area_world[node] * per_face * abs(along) * SHARE_UNITS / 2.0), SHARE_UNITS - 1.0
                )
                faces.cover[node, axis] = share
                faces.share[node, 2 * axis] = share if along > 0.0 else 0.0
                faces.share[node, 2 * axis + 1] = share if along < 0.0 else 0.0
            faces.light[node] = nodes.luminance[node]
            for face in range(FACES):
                faces.chroma[node, face] = nodes.chroma[node]
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
def _cover_axis(children, below, faces, node, axis):
    """Write the share of a node covered by its children along an axis."""
    free = 0.0
    for octant in range(8):
        if octant >> axis & 1 == 0:
            front, back = children[octant], children[octant | 1 << axis]
            open_front = 1.0 - below.cover[front, axis] / SHARE_UNITS if front >= 0 else 1.0
            free += open_front * (1.0 - below.cover[back, axis] / SHARE_UNITS) if back >= 0 else open_front
    faces.cover[node, axis] = np.rint((1.0 - free / 4.0) * SHARE_UNITS)


@device
def _show_face(children, below, faces, node, axis, lower):
    """Write a face of a node from the four columns of its children; lower: it is the lower one of its axis."""
    face = 2 * axis + lower
    total, backs, light, red, green, blue = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    colored = below.chroma.shape[2] > 0
    for octant in range(8):
        if octant >> axis & 1 == lower:
            continue
        free = 1.0
        for child in (children[octant], children[octant ^ 1 << axis]):
            if child < 0:
                continue
            weight = free * below.share[child, face]
            free *= 1.0 - below.cover[child, axis] / SHARE_UNITS
            total += weight
            backs += weight if below.share[child, face] & 1 else 0.0
            light += weight * below.light[child, face]
            if colored and weight > 0.0:
                hue = below.chroma[child, face]
                r, g, b = decode_color(below.light[child, face] / LUMINANCE_SCALE, hue[0], hue[1])
                red, green, blue = red + weight * r, green + weight * g, blue + weight * b
    # Small visible shares are kept: only their ratios count in the end.
    faces.share[node, face] = np.uint16(min(2.0 * np.ceil(total / 8.0), SHARE_UNITS - 1.0)) | np.uint16(
        2.0 * backs > total
    )
    faces.light[node, face] = np.rint(light / total) if total > 0.0 else 0
    if colored:
        scale = 1.0 / total if total > 0.0 else 0.0
        hue = encode_shares(light * scale / LUMINANCE_SCALE, red * scale, blue * scale)
        faces.chroma[node, face, 0], faces.chroma[node, face, 1] = hue
