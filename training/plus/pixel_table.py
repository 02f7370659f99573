# SPDX-License-Identifier: GPL-3.0-or-later
"""Table of pixels with all inputs of estimators, and their errors; augmented batches of it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache

import numpy as np

from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ...patchnet_addon.sampling.plus.features import windows_of
from ...patchnet_addon.sampling.plus.forms import Plane
from ...patchnet_addon.sampling.plus_planes import view_planes

SYMMETRIES = 8  # symmetries of a square
_RAYS = slice(Plane.RAY_0, Plane.RAY_3 + 1)


@dataclass(frozen=True, eq=False)
class PixelTable:
    """Table of N pixels.

    windows: (N, C, 9) float32 of all planes, in the order of `Plane`. errors: squared errors (N,) float32 by the plane
    of the shown picture.
    """

    windows: np.ndarray
    errors: dict[Plane, np.ndarray]

    @classmethod
    def of(cls, views: Iterable[PixelBuffers], pixels: int, seed: int) -> PixelTable:
        """Table of up to `pixels` active pixels of each view with its reference; chosen by the seed."""
        parts = [_pixels_of(view, pixels, np.random.default_rng([seed, number])) for number, view in enumerate(views)]
        return cls.joined(parts)

    @classmethod
    def joined(cls, parts: list[PixelTable]) -> PixelTable:
        """Join tables."""
        windows = np.concatenate([np.empty((0, len(Plane), 9), np.float32), *(part.windows for part in parts)])
        shown = (Plane.LUMINANCE, Plane.PREDICTED)
        none = np.empty(0, np.float32)
        return cls(windows, {name: np.concatenate([none, *(part.errors[name] for part in parts)]) for name in shown})

    def __len__(self) -> int:
        """Return the number of pixels."""
        return len(self.windows)

    def batch(self, rows: np.ndarray, symmetry: int) -> np.ndarray:
        """Windows (C, 9, B) of rows (B,), under one of the eight symmetries of a square."""
        places, rays = symmetries()[symmetry]
        windows = self.windows[rows][:, :, places]
        windows[:, _RAYS] = windows[:, _RAYS][:, rays]
        return np.ascontiguousarray(windows.transpose(1, 2, 0))


@cache
def symmetries() -> tuple[tuple[np.ndarray, np.ndarray], ...]:
    """Permutations of a window's 9 pixels and of a pixel's 4 rays by symmetry; the first is the identity."""
    grids = np.arange(9).reshape(3, 3), np.arange(4).reshape(2, 2)
    return tuple(
        tuple(np.rot90(grid.T if number >= 4 else grid, number % 4).ravel() for grid in grids)  # type: ignore[misc]
        for number in range(SYMMETRIES)
    )


def _pixels_of(view: PixelBuffers, pixels: int, random: np.random.Generator) -> PixelTable:
    assert view.reference is not None and view.predicted is not None
    active = np.flatnonzero(view.active)
    chosen = np.sort(random.choice(active, min(pixels, len(active)), replace=False))
    windows = windows_of(view_planes(view, tuple(Plane)))[:, :, chosen]
    shown = {Plane.LUMINANCE: view.preview, Plane.PREDICTED: view.predicted}
    errors = {name: (picture[chosen] - view.reference[chosen]) ** 2 for name, picture in shown.items()}
    return PixelTable(np.ascontiguousarray(windows.transpose(2, 0, 1)), errors)
