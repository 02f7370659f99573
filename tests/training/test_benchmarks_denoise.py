# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors of denoised light by region: what is where, and that errors are those of luminance over the surface."""

import numpy as np
import pytest

from patchnet.patchnet_addon.lightmap.atlas import Atlas
from patchnet.patchnet_addon.lightmap.charts import layout_charts
from patchnet.patchnet_addon.lightmap.denoised_atlas import placed_texels
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.mesh import Material, TriangleBatch, TriangleMesh
from patchnet.training.benchmarks.denoising import errors_by_region


def quad(*corners: tuple[float, float, float]) -> list[list[tuple[float, float, float]]]:
    return [[corners[0], corners[1], corners[2]], [corners[0], corners[2], corners[3]]]


def scene() -> TriangleMesh:
    """A floor of 32 x 16 m with a wall at its end, both of one material without texture."""
    floor = quad((0, 0, 0), (32, 0, 0), (32, 16, 0), (0, 16, 0))
    wall = quad((0, 0, 0), (0, 16, 0), (0, 16, 8), (0, 0, 8))
    corners = np.array(floor + wall, float)
    batch = TriangleBatch(corners, np.zeros((4, 3, 2), np.float32), np.zeros(4, np.int32), 0)
    return TriangleMesh((batch,), (Material("Clay", (0.5, 0.5, 0.5)),))


@pytest.fixture(scope="module")
def atlases() -> tuple[TriangleMesh, Atlas, Atlas, Atlas]:
    """Light that steps at x = 16; atlases off by 0.3 and by 0.1 everywhere, and one that knows its noise, 0.01."""
    source = scene()
    charts = drain(layout_charts(source, 1.0, page_side=64))
    blank = np.zeros((charts.texel_count, 2), np.float32)
    blank[:, 1] = 1.0
    known = Atlas(charts, blank, noise=np.full(len(blank), 0.01, np.float32))
    placed = placed_texels(known, source)
    light = blank.copy()
    light[placed.place, 0] = np.where(placed.texels.points[:, 0] < 16.0, 1.0, 0.2)
    off = [light + np.array([error, 0.0], np.float32) for error in (0.3, 0.1)]
    return source, Atlas(charts, off[0]), Atlas(charts, off[1]), Atlas(charts, light, noise=known.noise)


def test_regions_and_errors(atlases: tuple[TriangleMesh, Atlas, Atlas, Atlas]) -> None:
    source, noisy, denoised, reference = atlases
    found = {each.region: each for each in errors_by_region(noisy, denoised, reference, source)}
    assert set(found) == {"all", "smooth", "shadow edges", "contact shadows"}
    for each in found.values():
        assert each.noisy == pytest.approx(0.09, rel=1e-3) and each.denoised == pytest.approx(0.01, rel=1e-3)
        assert each.ratio == pytest.approx(1 / 9, rel=2e-3) and each.reference_noise == pytest.approx(1e-4, rel=1e-3)
        assert each.as_json()["ratio"] == each.ratio
    # The step is seen from 2.5 m, the other surface from 3 m; of 640 m2 of floor and wall.
    assert found["shadow edges"].share == pytest.approx(5 * 16 / 640, rel=0.4)
    assert found["contact shadows"].share == pytest.approx(2 * 3 * 16 / 640, rel=0.3)
    assert sum(each.share for each in found.values()) == pytest.approx(2.0)
