# SPDX-License-Identifier: GPL-3.0-or-later
"""Bound of how much the light of a surface changes when light elsewhere does, by form factors (methods 7.2i).

Pieces that lie in one cell and face the same way along an axis are one group; groups see each other as discs do, with
the sides that they face. That something may stand between is left out, and so is that some places become darker while
others become brighter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .pieces import Pieces

_ALONG = 24  # cells along the longest side
_MOST_GROUPS = 6000
_BOUNCES = 16
_CHUNK = 256


@dataclass(frozen=True, eq=False)
class Groups:
    """Groups of pieces.

    of: (N,) int64, group of each piece. centre: (G, 3), radius: (G,), of a ball around all its pieces. normal: (G, 3)
    mean; spread: (G,) largest angle to it in radians. area: (G,). albedo: (G,) share of light that it scatters, mean.
    """

    of: np.ndarray
    centre: np.ndarray
    radius: np.ndarray
    normal: np.ndarray
    spread: np.ndarray
    area: np.ndarray
    albedo: np.ndarray


def groups_of(pieces: Pieces, albedo: np.ndarray, along: int = _ALONG, most: int = _MOST_GROUPS) -> Groups:
    """Group pieces whose albedo is (N,), in fewer cells than `along` a side if there were more than `most` groups."""
    low, high = pieces.centre.min(axis=0), pieces.centre.max(axis=0)
    cell = max(float((high - low).max()) / along, 1e-30)
    x, y, z = np.minimum(((pieces.centre - low) / cell).astype(np.int64), along).T
    axis = np.abs(pieces.normal).argmax(axis=1)
    side = pieces.normal[np.arange(len(axis)), axis] > 0.0
    keys = (((x * (along + 1) + y) * (along + 1) + z) * 3 + axis) * 2 + side
    found, of = np.unique(keys, return_inverse=True)
    of = of.reshape(-1)
    if len(found) > most and along > 2:
        return groups_of(pieces, albedo, along * 3 // 4, most)
    count = len(found)
    weight = np.maximum(pieces.area, 1e-30)
    area = np.bincount(of, weight, count)
    centre = np.stack([np.bincount(of, weight * pieces.centre[:, i], count) for i in range(3)], -1) / area[:, None]
    normal = np.stack([np.bincount(of, weight * pieces.normal[:, i], count) for i in range(3)], -1)
    normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    radius, spread = np.zeros(count), np.zeros(count)
    np.maximum.at(radius, of, np.linalg.norm(pieces.centre - centre[of], axis=1) + pieces.radius)
    np.maximum.at(spread, of, np.arccos(np.clip(np.einsum("nc,nc->n", pieces.normal, normal[of]), -1.0, 1.0)))
    return Groups(of, centre, radius, normal, spread, area, np.bincount(of, weight * albedo, count) / area)


def change_bound(groups: Groups, changed: np.ndarray) -> np.ndarray:
    """Largest change of light that comes by way of others, as the luminance (G,) that it gives a white surface.

    changed: (G,) largest change of luminance that groups have at first, mean over their area.
    """
    factors = _between(groups)
    step = _gathered(factors, changed)
    total = step.copy()
    for _ in range(_BOUNCES):
        step = _gathered(factors, groups.albedo * step)
        total += step
        if step.max(initial=0.0) < 1e-3 * total.max(initial=0.0):
            break
    albedo = float(groups.albedo.max(initial=0.0))
    return total + albedo * float(step.max(initial=0.0)) / max(1.0 - albedo, 0.05)  # the rest of a series that falls


def _gathered(factors: np.ndarray, light: np.ndarray) -> np.ndarray:
    """Light (G,) that arrives from all groups."""
    arrived: np.ndarray = (factors @ light.astype(np.float32)).astype(np.float64)
    return arrived


def _between(groups: Groups) -> np.ndarray:
    """(G, G) float32, form factors of discs: the share of what arrives at the first that comes from the second.

    Rows sum up to at most 1.
    """
    count = len(groups.area)
    factors = np.empty((count, count), np.float32)
    centre, normal = groups.centre.astype(np.float32), groups.normal.astype(np.float32)
    spread, area = groups.spread.astype(np.float32), groups.area.astype(np.float32)
    for first in range(0, count, _CHUNK):
        part = slice(first, first + _CHUNK)
        offset = centre[None] - centre[part, None]  # (C, G, 3)
        square = np.einsum("cgx,cgx->cg", offset, offset)
        inverse = 1.0 / np.sqrt(np.maximum(square, np.float32(1e-30)))
        at = largest_cosine(np.einsum("cgx,cx->cg", offset, normal[part]) * inverse, spread[part, None])
        of = largest_cosine(-np.einsum("cgx,gx->cg", offset, normal) * inverse, spread[None])
        factors[part] = area[None] * at * of / (np.float32(np.pi) * square + area[None])
    flat = np.flatnonzero(groups.spread < 1e-3)
    factors[flat, flat] = 0.0  # a plane does not see itself
    factors /= np.maximum(factors.sum(axis=1, keepdims=True), 1.0)
    return factors


def largest_cosine(cosine: np.ndarray, slack: np.ndarray) -> np.ndarray:
    """Largest cosine of an angle that differs by at most `slack` radians, at least 0."""
    known = np.clip(cosine, -1.0, 1.0)
    turn = np.minimum(slack, np.pi)
    nearest = np.cos(turn)
    turned = known * nearest + np.sqrt(1.0 - known**2) * np.sin(turn)
    largest: np.ndarray = np.where(known >= nearest, 1.0, np.maximum(turned, 0.0)).astype(known.dtype)
    return largest
