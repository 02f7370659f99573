# SPDX-License-Identifier: GPL-3.0-or-later
"""Closed tubes along strands, and spheres at points, of flat triangles.

Their mean width over all directions is that of the round shape: the mean shadow of a convex body is a quarter of its
surface, so a tube has the perimeter of the round one, and a solid the surface area of the sphere.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

_GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))  # by which each tube is turned against the previous one


class Solids(NamedTuple):
    """vertices: (V, 3) float32. triangles: (T, 3) int32, wound to face outwards. points: (V,) point of each vertex.
    normals: (T, 3, 3) of spheres; None: flat.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    points: np.ndarray
    normals: np.ndarray | None


def tubes(points: np.ndarray, radii: np.ndarray, first: np.ndarray, sides: int) -> Solids:
    """Tubes with flat ends along strands of two points or more.

    points: (P, 3). radii: (P,). first: (S + 1,) int64, strand s has the points first[s] to first[s + 1].
    sides: preferably odd, so that mean light depends least on their orientation.
    """
    count = len(points)
    strand = np.repeat(np.arange(len(first) - 1), np.diff(first))
    angles = 2.0 * np.pi * np.arange(sides) / sides + strand[:, None] * _GOLDEN_ANGLE
    u, v = _frames(points.astype(np.float64), first)
    around = u[:, None] * np.cos(angles)[..., None] + v[:, None] * np.sin(angles)[..., None]
    wide = np.maximum(radii, 0.0) * np.pi / (sides * np.sin(np.pi / sides))
    vertices = (points[:, None] + around * wide[:, None, None]).reshape(-1, 3)
    side, ring = np.arange(sides), np.arange(count)[:, None] * sides
    a, b = ring + side, ring + (side + 1) % sides
    # From its first corner both edges of a triangle lead along the strand, whose direction hair shaders take from them.
    walls = np.stack([b + sides, a, b, a, b + sides, a + sides], axis=-1)[segments(first)]
    fan = np.stack([np.zeros(sides - 2, int), side[1:-1], side[2:]], axis=-1)
    tips, roots = ring[first[1:] - 1][:, None] + fan, ring[first[:-1]][:, None] + fan[:, [0, 2, 1]]
    triangles = np.concatenate([each.reshape(-1, 3) for each in (walls, tips, roots)])
    return Solids(vertices.astype(np.float32), triangles.astype(np.int32), np.repeat(np.arange(count), sides), None)


def tube_triangles(points: int, strands: int, sides: int) -> int:
    """Number of triangles of `tubes`."""
    return 2 * sides * (points - strands) + 2 * (sides - 2) * strands


def segments(first: np.ndarray) -> np.ndarray:
    """Index of the first point of each segment of the strands."""
    return np.delete(np.arange(first[-1]), first[1:] - 1)


def curve_middles(points: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Middles of all segments of Catmull-Rom curves through strands of points (P, C), with repeated end points."""
    starts, lengths = segments(first), np.diff(first) - 1
    before = np.maximum(starts - 1, np.repeat(first[:-1], lengths))
    after = np.minimum(starts + 2, np.repeat(first[1:] - 1, lengths))
    return (9.0 * (points[starts] + points[starts + 1]) - points[before] - points[after]) / 16.0


def _frames(points: np.ndarray, first: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two directions (P, 3) across each point's strand, which twist as little as they can along it."""
    starts = segments(first)
    along = _unit(points[starts + 1] - points[starts])
    tangents = np.zeros((len(points), 3))
    tangents[starts] += along
    tangents[starts + 1] += along
    tangents = _unit(tangents)
    u = _unit(np.cross(tangents, np.eye(3)[np.abs(tangents).argmin(axis=1)]))
    lengths = np.diff(first)
    for step in range(1, lengths.max()):
        at = first[:-1][lengths > step] + step
        turned = u[at - 1] - tangents[at] * (u[at - 1] * tangents[at]).sum(axis=1, keepdims=True)
        follows = (turned**2).sum(axis=1) > 1e-6
        u[at[follows]] = _unit(turned[follows])
    return u, np.cross(tangents, u)


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Normalized vectors; z for zero length."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.where(lengths > 0.0, vectors / np.where(lengths > 0.0, lengths, 1.0), [0.0, 0.0, 1.0])


def spheres(points: np.ndarray, radii: np.ndarray, divisions: int) -> Solids:
    """Spheres at points (P, 3) of radii (P,): octahedra whose faces are subdivided into four repeatedly."""
    solid, faces = _octahedron(divisions)
    corners = solid[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2.0
    wide, of_point = np.maximum(radii, 0.0) * np.sqrt(4.0 * np.pi / area), np.arange(len(points))
    vertices = (points[:, None] + solid * wide[:, None, None]).reshape(-1, 3).astype(np.float32)
    triangles = (faces + of_point[:, None, None] * len(solid)).reshape(-1, 3).astype(np.int32)
    normals = np.tile(corners, (len(points), 1, 1))
    return Solids(vertices, triangles, np.repeat(of_point, len(solid)), normals)


def sphere_triangles(points: int, divisions: int) -> int:
    """Number of triangles of `spheres`."""
    return points * 8 * 4**divisions


def _octahedron(divisions: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) of length 1 and faces (F, 3)."""
    vertices = np.concatenate([np.eye(3), -np.eye(3)])
    faces = np.array([(0, 1, 2), (1, 3, 2), (3, 4, 2), (4, 0, 2), (1, 0, 5), (3, 1, 5), (4, 3, 5), (0, 4, 5)])
    for _ in range(divisions):
        corners = vertices[faces]
        middles = _unit(corners + np.roll(corners, -1, axis=1))  # of the edges 01, 12 and 20
        a, b, c, d, e, f = np.arange(6 * len(faces)).reshape(2, -1, 3).transpose(0, 2, 1).reshape(6, -1)
        vertices = np.concatenate([corners, middles]).reshape(-1, 3)
        faces = np.stack([a, d, f, d, b, e, f, e, c, d, e, f], axis=-1).reshape(-1, 3)
    return vertices, faces
