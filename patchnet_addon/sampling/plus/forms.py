# SPDX-License-Identifier: GPL-3.0-or-later
"""Forms of the error estimator by their inputs, and their features as a table (methods 12.1).

A feature is computed from one plane of the view, at the pixel or at one of its eight neighbours. Both the reference
(`features.py`) and the kernel (`compiled.py`) read the table.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np

CENTRE = 4
WINDOW = tuple(range(9))  # places of the 3x3 window, row by row, the lowest first
AROUND = tuple(place for place in WINDOW if place != CENTRE)
# Rays of the neighbours that adjoin the pixel's own 2x2: ray (lower left, lower right, ...) and place.
NEXT_RAYS = (
    (3, 0), (2, 1), (3, 1), (2, 2), (1, 3), (3, 3), (0, 5), (2, 5), (1, 6), (0, 7), (1, 7), (0, 8)
)  # fmt: skip
SLOPE = 4.0  # pixel sides of depth that give half of the largest slope
FAR = 1.0e6  # cube sides: depth of a miss
BESIDE_RAYS = 0.1  # weight of the network's luminance in the squared scale where there are rays
HIDDEN_BEHIND = 0.01  # the same for the luminance behind, which most patches hide
FLOOR = 1.0e-5  # of the squared scale: differences below 0.003 are noise


class Plane(IntEnum):
    """Planes of a view that features are computed from."""

    LUMINANCE = 0  # L1
    HIT = 1
    DEPTH = 2  # axial, in cube sides; FAR for a miss
    PER_PIXEL = 3  # 1 / SLOPE pixel sides, per cube side
    NORMAL_X = 4  # unit
    NORMAL_Y = 5
    NORMAL_Z = 6
    COSINE = 7  # of normal and ray, without sign
    RATIO = 8  # pixel side / voxel side
    CHILDREN = 9  # of the voxel, eighths
    LOOK_AHEAD = 10
    COVERAGE = 11  # sigma
    PATCH = 12  # L_N
    BEHIND = 13  # L_B
    BEHIND_HIT = 14
    PREDICTED = 15  # P
    FINE = 16  # luminance of the finer ray in the pixel's centre
    OPEN = 17  # sigma L_N + (1 - sigma) times the mean luminance of the scene: P without a ray behind the patch
    RAY_0 = 18  # luminances of 2x2 finer rays
    RAY_1 = 19
    RAY_2 = 20
    RAY_3 = 21


NORMALS = (Plane.NORMAL_X, Plane.NORMAL_Y, Plane.NORMAL_Z)


class Kind(IntEnum):
    """Kinds of features, computed from a plane's value v at the feature's place and values in the pixel itself."""

    VALUE = 0  # v
    DIFFERENCE = 1  # (v - shown luminance) / scale
    SLOPE = 2  # x / (1 + |x|), x = (v - depth) per SLOPE pixel sides
    ANGLE = 3  # cosine of the normals there and here
    SCALE = 4  # logarithm of the scale


@dataclass(frozen=True)
class Feature:
    """Feature: kind, plane, place in the window; share: weight of its square in the squared scale."""

    kind: Kind
    plane: Plane
    place: int
    share: float = 0.0


@dataclass(frozen=True, eq=False)
class Form:
    """Form of the estimator.

    name: of its network in files. network: whether PatchNet's prediction is an input. rays: finer rays per pixel among
    its inputs, 0, 1 or 4 (2x2). behind: whether the luminance behind the patch is an input. shown: plane of the picture
    whose error it estimates, LUMINANCE or PREDICTED; luminance differences are relative to its pixel.
    """

    name: str
    network: bool
    rays: int
    behind: bool
    shown: Plane = Plane.LUMINANCE

    @cached_property
    def features(self) -> tuple[Feature, ...]:
        """Features in the order of the network's inputs: differences in one run, the logarithm of the scale last."""
        scale = Feature(Kind.SCALE, self.shown, CENTRE)
        return (*_luminances(self), *_geometry(self), scale)

    @cached_property
    def planes(self) -> tuple[Plane, ...]:
        """Planes of the features, in rising order."""
        found = {feature.plane for feature in self.features} | {self.shown, Plane.DEPTH, Plane.PER_PIXEL, *NORMALS}
        return tuple(sorted(found))

    @cached_property
    def table(self) -> np.ndarray:
        """Kinds, indices among `planes`, and places of the features, (3, F) int64."""
        index = {plane: number for number, plane in enumerate(self.planes)}
        rows = [(feature.kind, index[feature.plane], feature.place) for feature in self.features]
        return np.array(rows, np.int64).T.copy()

    @cached_property
    def shares(self) -> np.ndarray:
        """(F,) float32: weights of the features' squares in the squared scale."""
        return np.array([feature.share for feature in self.features], np.float32)

    @property
    def description(self) -> str:
        """Features in words, stored in a file of weights."""
        parts = [
            f"{feature.kind.name} {feature.plane.name} {feature.place} {feature.share:.4g}" for feature in self.features
        ]
        return f"slope {SLOPE:g}, floor {FLOOR:g}: " + ", ".join(parts).lower()


def _differences(*where: tuple[Plane, int], weight: float = 1.0) -> Iterator[Feature]:
    """Group of luminance differences: the mean of their squares is a part of the squared scale."""
    for plane, place in where:
        yield Feature(Kind.DIFFERENCE, plane, place, weight / len(where))


def _all_of(plane: Plane, places: tuple[int, ...] = WINDOW, weight: float = 1.0) -> Iterator[Feature]:
    return _differences(*((plane, place) for place in places), weight=weight)


def _luminances(form: Form) -> Iterator[Feature]:
    predicted = form.shown == Plane.PREDICTED
    yield Feature(Kind.VALUE, form.shown, CENTRE)
    yield from _all_of(Plane.LUMINANCE, WINDOW if predicted else AROUND)
    if form.network:
        yield from _all_of(Plane.PATCH, weight=BESIDE_RAYS if form.rays else 1.0)
        if not form.rays:
            yield from _all_of(Plane.OPEN, (CENTRE,))
    if form.rays == 1 or predicted:
        yield from _all_of(Plane.FINE)
    if form.behind and not predicted:
        yield from _all_of(Plane.BEHIND, (CENTRE,), weight=HIDDEN_BEHIND)
        if form.network:
            yield from _all_of(Plane.PREDICTED)
    if predicted:
        yield from _all_of(Plane.BEHIND, (CENTRE,))
        yield from _all_of(Plane.PREDICTED, AROUND)
    if form.rays == 4:
        yield from _differences(*((Plane(Plane.RAY_0 + ray), CENTRE) for ray in range(4)))
        yield from _differences(*((Plane(Plane.RAY_0 + ray), place) for ray, place in NEXT_RAYS))


def _geometry(form: Form) -> Iterator[Feature]:
    for place in WINDOW:
        yield Feature(Kind.VALUE, Plane.HIT, place)
    for place in AROUND:
        yield Feature(Kind.SLOPE, Plane.DEPTH, place)
    for place in AROUND:
        yield Feature(Kind.ANGLE, Plane.NORMAL_X, place)
    for plane in (Plane.COSINE, Plane.RATIO, Plane.CHILDREN):
        yield Feature(Kind.VALUE, plane, CENTRE)
    if form.network:
        yield Feature(Kind.VALUE, Plane.LOOK_AHEAD, CENTRE)
        for place in WINDOW:
            yield Feature(Kind.VALUE, Plane.COVERAGE, place)
    if form.behind:
        yield Feature(Kind.VALUE, Plane.BEHIND_HIT, CENTRE)


_ALL = (
    *(Form(f"plus-{rays}", True, rays, rays > 0) for rays in (0, 1, 4)),
    *(Form(f"plain-{rays}", False, rays, rays > 0) for rays in (0, 1, 4)),
    *(Form(f"predicted-{rays}", True, rays, True, shown=Plane.PREDICTED) for rays in (1, 4)),
)
FORMS: dict[str, Form] = {form.name: form for form in _ALL}
