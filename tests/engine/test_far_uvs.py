# SPDX-License-Identifier: GPL-3.0-or-later
"""UV coordinates beyond single precision, infinite or NaN: lookups end, surfaces stay."""

import itertools

import numpy as np
import pytest

from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.surface.mesh import Material, Texture, TriangleBatch, TriangleMesh
from patchnet.patchnet_addon.surface.shading import albedo_shade

from .leaf_samples import leaves_of

CORNERS = np.array([[(0.1, 0.1, 0.11), (0.9, 0.1, 0.11), (0.1, 0.9, 0.11)]])
RASTER = np.linspace(0.2, 0.9, 64, dtype=np.float32).reshape(8, 8, 1)


def looked_up(uvs: np.ndarray, wrap: str, threshold: float | None, transform: tuple | None) -> tuple[float, float]:
    """Opaque area of one triangle, and its luminance times that area."""
    base = Texture("base", np.repeat(RASTER, 3, axis=-1), wrap, transform)
    alpha = Texture("alpha", RASTER, wrap, transform)
    material = Material("m", (1.0, 1.0, 1.0), base_texture=base, alpha_texture=alpha, alpha_threshold=threshold)
    mesh = TriangleMesh((TriangleBatch(CORNERS, uvs.astype(np.float32)[None], np.zeros(1, np.int32), 0),), (material,))
    leaves = leaves_of(mesh, Grid((0.0, 0.0, 0.0), 1.0, 4), albedo_shade(mesh))
    return tuple(float(sum(part.sums[:, column].sum() for part in leaves)) for column in (0, 1))


@pytest.mark.parametrize(
    ("wrap", "threshold", "value"),
    [*itertools.product(("REPEAT", "EXTEND", "MIRROR", "CLIP"), (None, 0.5), (1e6, 1e19, -1e19, 1e38, np.inf, np.nan))],
)
def test_lookups_end_and_are_finite(wrap: str, threshold: float | None, value: float) -> None:
    everywhere, one_corner, across = np.full((3, 2), value), np.zeros((3, 2)), np.array([(-1, 1), (1, -1), (1, 1)])
    one_corner[1] = value
    for uvs in (everywhere, one_corner, across * value):
        area, luminance = looked_up(uvs, wrap, threshold, None)
        assert 0.0 <= area <= 0.32 + 1e-6 and 0.0 <= luminance <= 0.32
        scaled = looked_up(uvs, wrap, threshold, ((1e30, 0.0, 0.0), (0.0, 1e30, 0.5)))
        assert np.isfinite(scaled).all()


@pytest.mark.parametrize("value", [3e7, 1e19, 1e38])
def test_far_coordinates_are_whole_numbers(value: float) -> None:
    """As in single precision, in which a renderer counts texels."""
    for wrap, same in (("REPEAT", 0.0), ("MIRROR", 0.0), ("EXTEND", 5.0), ("CLIP", 5.0)):
        found = looked_up(np.full((3, 2), value), wrap, None, None)
        assert found == pytest.approx(looked_up(np.full((3, 2), same), wrap, None, None), rel=1e-5)
