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


def groups_of(pieces: Pieces, albedo: np.ndarray, along: int = _ALONG) -> Groups:
    """Group pieces whose albedo is (N,), in fewer cells than `along` a side if there were too many."""
    low, high = pieces.centre.min(axis=0), pieces.centre.max(axis=0)
    cell = max(float((high - low).max()) / along, 1e-30)
    x, y, z = np.minimum(((pieces.centre - low) / cell).astype(np.int64), along).T
    axis = np.abs(pieces.normal).argmax(axis=1)
    side = pieces.normal[np.arange(len(axis)), axis] > 0.0
    keys = (((x * (along + 1) + y) * (along + 1) + z) * 3 + axis) * 2 + side
    found, of = np.unique(keys, return_inverse=True)
    of = of.reshape(-1)
    if len(found) > _MOST_GROUPS and along > 2:
        return groups_of(pieces, albedo, along * 3 // 4)
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


def change_bound(
    groups: Groups, changed: np.ndarray, boxes: np.ndarray, areas: np.ndarray, box_light: float
) -> np.ndarray:
    """Largest change of light that comes by way of others, as the luminance (G,) that it gives a white surface.

    changed: (G,) largest change of luminance of groups whose direct light changed, mean over their area. boxes: (B, 2,
    3), in which things of the surface `areas` (B,) came, went or changed: what is seen in their place changes by at
    most `box_light`.
    """
    factors = _between(groups)
    change = np.zeros(len(groups.area))
    for box, area in zip(*joined_boxes(boxes, areas), strict=True):
        change += _of_box(groups, box, min(_half_surface(box), float(area)))
    step = np.minimum(change, 1.0) * box_light + _gathered(factors, changed)
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
    for first in range(0, count, _CHUNK):
        part = slice(first, first + _CHUNK)
        offset = groups.centre[None] - groups.centre[part, None]  # (C, G, 3)
        square = np.einsum("cgx,cgx->cg", offset, offset)
        direction = offset / np.sqrt(np.maximum(square, 1e-30))[..., None]
        at = _largest_cosine(np.einsum("cgx,cx->cg", direction, groups.normal[part]), groups.spread[part, None])
        of = _largest_cosine(-np.einsum("cgx,gx->cg", direction, groups.normal), groups.spread[None])
        factors[part] = groups.area[None] * at * of / (np.pi * square + groups.area[None])
    flat = np.flatnonzero(groups.spread < 1e-3)
    factors[flat, flat] = 0.0  # a plane does not see itself
    return factors / np.maximum(factors.sum(axis=1, keepdims=True), 1.0)


def _of_box(groups: Groups, box: np.ndarray, shown: float) -> np.ndarray:
    """Share (G,) of what arrives that things in a box (2, 3) hide or send whose views have the area `shown` at most."""
    size = np.ptp(box, axis=0)
    outside = np.maximum(np.maximum(box[0] - groups.centre, groups.centre - box[1]), 0.0)
    near = np.maximum(np.linalg.norm(outside, axis=1) - groups.radius, 1e-12)
    offset = box.mean(axis=0) - groups.centre
    distance = np.maximum(np.linalg.norm(offset, axis=1), 1e-30)
    slack = np.arcsin(np.clip((groups.radius + np.linalg.norm(size) / 2) / distance, 0.0, 1.0))
    cosine = np.einsum("gx,gx->g", offset / distance[:, None], groups.normal)
    share: np.ndarray = np.minimum(
        shown * _largest_cosine(np.abs(cosine), groups.spread + slack) / (np.pi * near**2), 1.0
    )
    return share


def joined_boxes(boxes: np.ndarray, areas: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Boxes (B, 2, 3) and areas (B,) with those as one that show no more together: the parts of a chair that moved."""
    left, shown = list(boxes), areas.tolist()
    joined = True
    while joined:
        joined = False
        for one in range(len(left)):
            for other in range(one + 1, len(left)):
                both = np.stack([np.minimum(left[one], left[other])[0], np.maximum(left[one], left[other])[1]])
                if _half_surface(both) <= _half_surface(left[one]) + _half_surface(left[other]):
                    left[one], shown[one] = both, shown[one] + shown[other]
                    del left[other], shown[other]
                    joined = True
                    break
    return np.array(left).reshape(-1, 2, 3), np.array(shown)


def _half_surface(box: np.ndarray) -> float:
    """Half of a box's surface: no view of it is larger."""
    x, y, z = (box[1] - box[0]).tolist()
    return float(x * y + y * z + z * x)


def _largest_cosine(cosine: np.ndarray, slack: np.ndarray) -> np.ndarray:
    """Largest cosine of an angle that differs by at most `slack` radians, at least 0."""
    angle = np.arccos(np.clip(cosine, -1.0, 1.0))
    largest: np.ndarray = np.maximum(np.cos(np.maximum(angle - slack, 0.0)), 0.0)
    return largest
