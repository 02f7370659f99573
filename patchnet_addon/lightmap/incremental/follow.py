# SPDX-License-Identifier: GPL-3.0-or-later
"""Follow what a change does to baked light: which triangles have to be baked again, and what the others may lack."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...runtime.progress import Progress, Steps
from ...surface.chroma import REC709
from ...surface.mesh import Material, MeshSource
from .bounce import change_bound, groups_of
from .hidden import hidden_share
from .pieces import Pieces, pieces_of
from .shadows import Lamp, may_shadow

_BRIGHTEST = 0.999  # quantile of the surface's luminance: above it are sparks of noise
_WHITE = 0.995  # as of the automatic exposure (methods 7.1)
_FINE, _MOST_FINE = 64, 60_000  # cells a side and groups for what is near to a change
_LIGHTEST = 0.95  # quantile of a texture's albedo


@dataclass(frozen=True, eq=False)
class Change:
    """Change of a scene since a bake.

    boxes: (B, 2, 3) float64 in world units: what came, went, moved or looks otherwise, before and after. areas: (B,)
    float64, surface of what is in them. lamps: all that cast shadows. lit: those that came, went or changed, before and
    after.
    """

    boxes: np.ndarray
    areas: np.ndarray
    lamps: tuple[Lamp, ...] = ()
    lit: tuple[Lamp, ...] = ()


@dataclass(frozen=True, eq=False)
class Levels:
    """Luminance of a baked surface without its emitters, before exposure: what is white, and the brightest there is."""

    white: float
    brightest: float

    @classmethod
    def of(cls, luminance: np.ndarray, area: np.ndarray) -> Levels:
        """Quantiles by area of the luminance (T,) of triangles with the areas (T,)."""
        order = np.argsort(luminance)
        share = np.cumsum(area[order])
        if not len(order) or share[-1] <= 0.0:
            return cls(0.0, 0.0)
        at = np.searchsorted(share, np.array([_WHITE, _BRIGHTEST]) * share[-1])
        white, brightest = luminance[order[np.minimum(at, len(order) - 1)]].tolist()
        return cls(white, brightest)


def follow(source: MeshSource, change: Change, brightest: float, limit: float) -> Steps[tuple[np.ndarray, np.ndarray]]:
    """Triangles (T,) bool whose light may change by more than `limit`, and bounds (T,) of how much each changes.

    brightest: luminance of any surface or sky. Luminances are before exposure.
    """
    pieces = yield from pieces_of(source)
    albedo = (yield from _albedo_of_triangles(source))[pieces.triangle]
    yield Progress(0, 1, "Following shadows")
    near = groups_of(pieces, albedo, _FINE, _MOST_FINE)
    direct = np.zeros(len(pieces.area))
    boxes = np.unique(change.boxes, axis=0)
    for number, lamp in enumerate(change.lamps):
        yield Progress(number, len(change.lamps), "Following shadows")
        part = np.flatnonzero(may_shadow(near, lamp, boxes)[near.of])
        mine = Pieces(*(values[part] for values in pieces))
        light = np.minimum(lamp.light_on(mine, albedo[part]), brightest)
        direct[part] += np.where(may_shadow(mine, lamp, boxes), light, 0.0)
    yield Progress(0, 1, "Following light")
    direct += sum((lamp.light_on(pieces, albedo) for lamp in change.lit), np.zeros(len(albedo)))
    direct += albedo * (hidden_share(near, change.boxes, change.areas) * brightest)[near.of]
    yield Progress(1, 2, "Following light")
    bound = direct + _scattered(pieces, albedo, direct)
    most = np.zeros(source.triangle_count)
    np.maximum.at(most, pieces.triangle, bound)
    return most > limit, most


def _scattered(pieces: Pieces, albedo: np.ndarray, changed: np.ndarray) -> np.ndarray:
    """Bound (N,) for what comes by way of other surfaces whose light changed by at most `changed` (N,) at first."""
    groups = groups_of(pieces, albedo)
    weight = np.maximum(pieces.area, 1e-30)
    mean = np.bincount(groups.of, weight * changed, len(groups.area)) / groups.area
    bound: np.ndarray = albedo * change_bound(groups, mean)[groups.of]
    return bound


def _albedo_of_triangles(source: MeshSource) -> Steps[np.ndarray]:
    """(T,) float64, the lightest part of a material's base colour."""
    of_material = np.array([albedo_of(material) for material in source.materials])
    albedo = np.empty(source.triangle_count)
    for batch in source.batches():
        albedo[batch.first_triangle : batch.first_triangle + len(batch)] = of_material[batch.materials]
        yield Progress(batch.first_triangle + len(batch), source.triangle_count, "Following light")
    return albedo


def albedo_of(material: Material) -> float:
    """Luminance of the base colour, of a texture that of its lightest twentieth; at most 0.95."""
    weight = np.asarray(REC709)
    if material.base_texture is None:
        value = float(np.dot(material.base_color, weight))
    else:
        pixels = material.base_texture.pixels.reshape(-1, material.base_texture.pixels.shape[-1])[..., :3]
        colors = pixels * np.asarray(material.base_color)[: pixels.shape[1]]
        shown = colors @ weight if colors.shape[1] == 3 else colors[:, 0]
        value = float(np.quantile(shown, _LIGHTEST))
    return min(max(value, 0.0), 0.95)


def luminance_of_emission(material: Material) -> float:
    """Luminance that a material sends out by itself."""
    return float(np.dot(material.emission, np.asarray(REC709)))
