# SPDX-License-Identifier: GPL-3.0-or-later
"""Faces that lie exactly on each other and face the same way, where Cycles' own light is arbitrary, often black.

Looking for them takes less than 2 % of the time that reading the scene takes, so large meshes are sampled.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...patchnet_addon.runtime.quantities import named_list
from ...patchnet_addon.surface.scene_mesh import MeshInstances, Run, SceneMesh

_SAMPLES, _MOST_MESHES = 1 << 10, 64  # triangles of a mesh that are compared; the largest meshes that are inspected
_MOST_BOXES = 64  # objects that are compared with others in equal boxes
_LEAST_SHARE = 1e-3  # of the compared triangles: fewer are hardly seen
_STEP = 1e-6  # of the scene, to which places are rounded
_MOST_FLAT = 256  # flat meshes in a plane, the largest ones
_FILLED = 0.999  # least share of its box that a flat mesh covers
_FACTORS = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xC2B2AE3D27D4EB4F)
_MIX = np.array([0x9E3779B1, 0x85EBCA77, 0xC2B2AE3D], np.uint32)


def coincidence_warnings(source: SceneMesh) -> list[str]:
    """Sentence that names objects with faces on those of others, or on their own; none without any."""
    placed = [(part, index) for part in source.parts for index in range(len(part.objects))]
    largest = sorted(source.parts, key=lambda part: -len(part.mesh))[:_MOST_MESHES]
    doubled = [part.objects[0] for part in largest if _is_doubled(part)]
    doubled += [*_in_equal_boxes(source, placed), *_in_equal_planes(source, placed)]
    if not doubled:
        return []
    return [
        f"Faces of {named_list(sorted(set(doubled)))} lie exactly on others, where light is arbitrary, in Cycles too: "
        "delete or move one of them"
    ]


def _is_doubled(part: MeshInstances) -> bool:
    """Return whether faces of a mesh lie on each other."""
    vertices, triangles = part.mesh.vertices, part.mesh.triangles
    if part.mesh.thickness:
        return False
    if len(triangles) > _SAMPLES:  # those that begin at some places, so that both of a pair are among them
        x, y, z = vertices.view(np.uint32).T
        mixed = x * _MIX[0] + y * _MIX[1] + z * _MIX[2]
        chosen = (mixed ^ (mixed >> np.uint32(15))) * _MIX[0] < np.uint32(2**32 * (_SAMPLES / len(triangles)))
        triangles = triangles[chosen[triangles[:, 0]]]
    keys = _keys(vertices[triangles])
    return len(keys) - len(np.unique(keys)) > _LEAST_SHARE * len(keys)


def _in_equal_boxes(source: SceneMesh, placed: list[tuple[MeshInstances, int]]) -> Iterator[str]:
    """Names of objects whose faces lie on those of another one in the same box."""
    step = _STEP * max(float(np.ptp(source.bounds_world, axis=0).max()), 1e-30)
    boxes = _hash(np.rint(source.boxes_world.reshape(-1, 6) / step) + 0.0)
    _, group, counts = np.unique(boxes, return_inverse=True, return_counts=True)
    met: dict[int, tuple[np.ndarray, str]] = {}
    for number in np.flatnonzero(counts[group] > 1)[:_MOST_BOXES].tolist():
        part, index = placed[number]
        if part.mesh.thickness:
            continue
        corners = Run(part, index, index + 1, 0, min(len(part.mesh), _SAMPLES)).corners_world()
        own = _keys(np.rint(corners / step)), part.objects[index]
        keys, name = met.setdefault(int(group[number]), own)
        if keys is not own[0] and np.isin(own[0], keys).sum() > _LEAST_SHARE * len(keys):
            yield from (name, own[1])


def _in_equal_planes(source: SceneMesh, placed: list[tuple[MeshInstances, int]]) -> Iterator[str]:
    """Names of flat objects that cover their boxes, of which another one's in the same plane covers a part."""
    low, size = source.boxes_world[:, 0], np.ptp(source.boxes_world, axis=1)
    step = _STEP * max(float(size.max()), 1e-30)
    for axis in range(3):
        others = [other for other in range(3) if other != axis]
        area = size[:, others].prod(axis=1)
        flat = np.flatnonzero((size[:, axis] <= step) & (area > 0.0))
        heights = np.rint(low[flat, axis] / step)
        values, counts = np.unique(heights, return_counts=True)
        for height in values[counts > 1]:
            mine = flat[heights == height]
            mine = mine[np.argsort(-area[mine])[:_MOST_FLAT]]
            mine = mine[[_covers(placed[number], float(area[number])) for number in mine]]
            begin, end = low[mine][:, others], (low + size)[mine][:, others]
            shared = np.minimum(end[:, None], end) - np.maximum(begin[:, None], begin)  # (N, N, 2)
            overlaps = (shared > 1e-3 * size[mine][:, None, others]).all(axis=-1)
            yield from (placed[number][0].objects[placed[number][1]] for number in mine[overlaps.sum(axis=1) > 1])


def _covers(placed: tuple[MeshInstances, int], area: float) -> bool:
    """Return whether a flat mesh covers its box of that area."""
    part, index = placed
    if part.mesh.thickness or len(part.mesh) > _SAMPLES:
        return False
    corners = part.mesh.vertices.astype(np.float64)[part.mesh.triangles] @ part.matrices_world[index, :3, :3].T
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return bool(0.5 * np.linalg.norm(cross, axis=1).sum() >= _FILLED * area)


def _keys(corners: np.ndarray) -> np.ndarray:
    """Keys (N,) uint64 of places and facing of triangles (N, 3, 3) with an area."""
    of_corners = _hash(corners.reshape(-1, 3) + corners.dtype.type(0.0)).reshape(-1, 3)  # there is no -0
    of_corners = of_corners[(of_corners != np.roll(of_corners, 1, axis=1)).all(axis=1)]
    turn = (of_corners.argmin(axis=1)[:, None] + np.arange(3)) % 3  # the first corner is arbitrary
    return _hash(np.take_along_axis(of_corners, turn, axis=1))


def _hash(rows: np.ndarray) -> np.ndarray:
    """Hash (N,) uint64 of the bits of rows (N, C)."""
    bits = np.ascontiguousarray(rows).view(np.uint32 if rows.dtype.itemsize == 4 else np.uint64)
    total = np.full(len(rows), rows.dtype.itemsize, np.uint64)  # places and their hashes are mixed differently
    for column in bits.T:
        total = (total ^ column) * _FACTORS[0] + _FACTORS[1]
        total ^= total >> np.uint64(29)
        total *= _FACTORS[1]
        total ^= total >> np.uint64(32)
    return total
