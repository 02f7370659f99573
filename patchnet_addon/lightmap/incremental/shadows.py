# SPDX-License-Identifier: GPL-3.0-or-later
"""Shadows that a box could cast: whether it may stand between a piece of surface and a lamp (methods 7.2i)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from .pieces import Pieces

_CHUNK = 1 << 16
_LEAN = 0.1  # of shading normals from those of the surface, as what it adds to a cosine


class Balls(Protocol):
    """Balls: centre (N, 3) and radius (N,) in world units."""

    @property
    def centre(self) -> np.ndarray:
        """Middles."""

    @property
    def radius(self) -> np.ndarray:
        """Radii."""


@dataclass(frozen=True)
class Lamp:
    """Lamp as shadows ask for it.

    place: position in world units, or the unit direction to one that is infinitely far. is_far: whether it is.
    radius: of a ball around it in world units; of a far one the tangent of the half angle that it is seen under.
    intensity: radiant intensity where it is strongest, of a far one what falls on a plane that faces it; as luminance,
    infinite where nobody knows.
    """

    place: tuple[float, float, float]
    radius: float
    is_far: bool = False
    intensity: float = math.inf

    def light_on(self, pieces: Pieces, albedo: np.ndarray) -> np.ndarray:
        """Luminance (N,) that it gives pieces of an albedo (N,) at most, as if nothing stood in its way."""
        if not math.isfinite(self.intensity):
            return np.full(len(pieces.area), np.inf)
        if self.is_far:  # from either side, on normals that may lean
            cosine = np.abs(pieces.normal @ np.asarray(self.place)) + self.radius + _LEAN
            return np.asarray(albedo * self.intensity / np.pi * np.minimum(cosine, 1.0))
        distance = np.linalg.norm(pieces.centre - np.asarray(self.place), axis=1) - pieces.radius - self.radius
        light: np.ndarray = albedo * self.intensity / (np.pi * np.maximum(distance, 1e-6) ** 2)
        return light


def may_shadow(pieces: Balls, lamp: Lamp, boxes: np.ndarray) -> np.ndarray:
    """(N,) bool: a segment from a ball to a ball around the lamp may meet one of the boxes (B, 2, 3).

    The segment between the centres is asked, against boxes that are larger by the larger of both radii: never too few.
    """
    met = np.zeros(len(pieces.centre), bool)
    place = np.asarray(lamp.place, np.float64)
    for first in range(0, len(met), _CHUNK):
        part = slice(first, first + _CHUNK)
        centre, radius = pieces.centre[part], pieces.radius[part]
        along = np.broadcast_to(place, centre.shape) if lamp.is_far else place - centre
        for box in boxes:
            if lamp.is_far:
                reach = np.linalg.norm(np.abs(centre - box.mean(axis=0)) + np.ptp(box, axis=0) / 2, axis=1)
                grown = radius + lamp.radius * reach
            else:
                grown = np.maximum(radius, lamp.radius)
            met[part] |= _crosses(centre, along, box, grown, np.inf if lamp.is_far else 1.0)
    return met


def _crosses(origin: np.ndarray, along: np.ndarray, box: np.ndarray, grown: np.ndarray, end: float) -> np.ndarray:
    """(N,) bool: origin + t along, 0 <= t <= end, meets a box (2, 3) that is larger by `grown` (N,) on all sides."""
    low, high = box[0] - grown[:, None], box[1] + grown[:, None]
    flat = np.abs(along) < 1e-300
    safe = np.where(flat, 1.0, along)
    near, far = (low - origin) / safe, (high - origin) / safe
    enter, leave = np.minimum(near, far), np.maximum(near, far)
    inside = (origin >= low) & (origin <= high)
    enter = np.where(flat, np.where(inside, -np.inf, np.inf), enter)
    leave = np.where(flat, np.where(inside, np.inf, -np.inf), leave)
    crossed: np.ndarray = np.maximum(enter.max(axis=1), 0.0) <= np.minimum(leave.min(axis=1), end)
    return crossed
