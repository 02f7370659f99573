# SPDX-License-Identifier: GPL-3.0-or-later
"""Share of what arrives at a surface that things in a box hide or send (methods 7.2i)."""

from __future__ import annotations

import numpy as np

from .bounce import Groups, largest_cosine

_PER_SIDE = 6  # patches along a side of a box's face
_MARGIN = 1.1  # for sums over patches in the place of integrals


def hidden_share(groups: Groups, boxes: np.ndarray, areas: np.ndarray) -> np.ndarray:
    """Largest share (G,) of what arrives anywhere in a group that things in boxes (B, 2, 3) hide or send.

    areas: (B,) surface of the things: no view of them is larger. At least what either side of the group sees of each
    box, larger by the group's radius: to a point beside the centre it lies as much to the other side.
    """
    share = np.zeros(len(groups.area))
    for box, area in zip(*joined_boxes(boxes, areas), strict=True):
        shown = min(_half_surface(box), float(area))
        near, cosine = _nearest(groups, box)
        share += np.minimum(_of_box(groups, box), shown * cosine / (np.pi * np.maximum(near, 1e-12) ** 2))
    return np.minimum(share, 1.0)


def _nearest(groups: Groups, box: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance (G,) from the groups' balls to a box (2, 3), and largest cosine (G,) that they see a thing in it by."""
    outside = np.maximum(np.maximum(box[0] - groups.centre, groups.centre - box[1]), 0.0)
    near = np.maximum(np.linalg.norm(outside, axis=1) - groups.radius, 0.0)
    offset = box.mean(axis=0) - groups.centre
    distance = np.maximum(np.linalg.norm(offset, axis=1), 1e-30)
    slack = np.arcsin(np.clip((groups.radius + np.linalg.norm(np.ptp(box, axis=0)) / 2) / distance, 0.0, 1.0))
    cosine = np.einsum("gx,gx->g", offset / distance[:, None], groups.normal)
    return near, largest_cosine(np.abs(cosine), groups.spread + slack)


def _of_box(groups: Groups, box: np.ndarray) -> np.ndarray:
    """Form factor (G,) of a box (2, 3) as the more of both sides of a group sees it; 1 where it is too near to say."""
    low, high = box[0] - groups.radius[:, None], box[1] + groups.radius[:, None]
    size = high - low
    outside = np.linalg.norm(np.maximum(np.maximum(low - groups.centre, groups.centre - high), 0.0), axis=1)
    result = np.ones(len(groups.area))
    far = np.flatnonzero(outside > size.max(axis=1) / _PER_SIDE)
    front, back = np.zeros(len(far)), np.zeros(len(far))
    lean = np.sin(np.minimum(groups.spread[far], np.pi / 2)), np.cos(np.minimum(groups.spread[far], np.pi / 2))
    for axis in range(3):
        for face in (low, high):
            offset = face[far, axis] - groups.centre[far, axis]
            seen = offset > 0.0 if face is low else offset < 0.0
            sides = _of_face(groups, far[seen], axis, offset[seen], low, size, (lean[0][seen], lean[1][seen]))
            front[seen] += sides[0]
            back[seen] += sides[1]
    result[far] = np.minimum(_MARGIN * np.maximum(front, back), 1.0)
    return result


def _of_face(
    groups: Groups,
    chosen: np.ndarray,
    axis: int,
    offset: np.ndarray,
    low: np.ndarray,
    size: np.ndarray,
    lean: tuple[np.ndarray, np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """Form factors (C,) of a face across `axis`, `offset` (C,) away, for the front and the back of `chosen` groups.

    low, size: (G, 3) of the box as each group sees it. lean: (C,) sine and cosine of the groups' spread.
    """
    u, v = (axis + 1) % 3, (axis + 2) % 3
    normal, start = groups.normal[chosen], low[chosen] - groups.centre[chosen]
    step = size[chosen] / _PER_SIDE
    front, back = np.zeros(len(chosen)), np.zeros(len(chosen))
    for row in range(_PER_SIDE):
        along_u = start[:, u] + (row + 0.5) * step[:, u]
        for column in range(_PER_SIDE):
            along_v = start[:, v] + (column + 0.5) * step[:, v]
            square = offset**2 + along_u**2 + along_v**2
            up = normal[:, axis] * offset + normal[:, u] * along_u + normal[:, v] * along_v  # cosine times distance
            across = np.sqrt(np.maximum(square - up**2, 0.0)) * lean[0]
            weight = step[:, u] * step[:, v] * np.abs(offset) / (np.pi * square**2)
            front += weight * np.maximum(up * lean[1] + across, 0.0)
            back += weight * np.maximum(across - up * lean[1], 0.0)
    return front, back


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
