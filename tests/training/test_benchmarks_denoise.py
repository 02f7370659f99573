# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors of denoised light by region: what is where, and that errors are those of luminance over the surface."""

from dataclasses import replace

import numpy as np
import pytest

from patchnet.commands.benches.denoise import samples_of_error
from patchnet.patchnet_addon.lightmap.atlas import Atlas
from patchnet.patchnet_addon.lightmap.charts import layout_charts
from patchnet.patchnet_addon.lightmap.denoised_atlas import placed_texels
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.mesh import Material, TriangleBatch, TriangleMesh
from patchnet.training.benchmarks.denoising import errors_by_region, in_blocks


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


def test_errors_are_measured_where_the_reference_is(atlases: tuple[TriangleMesh, Atlas, Atlas, Atlas]) -> None:
    """On the wall alone: contact and smooth light, as if all were known, and rivals beside."""
    source, noisy, denoised, reference = atlases
    placed = placed_texels(reference, source)
    floor = placed.place[placed.texels.normals[:, 2] > 0.5]
    part = reference.texels.copy()
    part[floor] = 0.0
    found = errors_by_region(noisy, denoised, replace(reference, texels=part), source, {"rival": noisy})
    assert {each.region for each in found} == {"all", "smooth", "contact shadows"}
    shares = {each.region: each.share for each in found}
    assert shares["contact shadows"] == pytest.approx(3 / 8, rel=0.3)
    for each in found:
        assert each.denoised == pytest.approx(0.01, rel=1e-3)
        assert each.rivals == {"rival": pytest.approx(each.noisy)}


def test_blocks_take_their_share_of_the_surface() -> None:
    """Triangles whose centres lie in the same cube are taken or left together."""
    rng = np.random.default_rng(0)
    corners = rng.uniform(0.0, 200.0, (4000, 1, 3)) + rng.normal(size=(4000, 3, 3))
    batch = TriangleBatch(corners, np.zeros((4000, 3, 2), np.float32), np.zeros(4000, np.int32), 0)
    source = TriangleMesh((batch,), (Material("Clay"),))
    chosen = in_blocks(source, 1.0, 0.25)
    assert chosen.mean() == pytest.approx(0.25, abs=0.06)
    cells = ((corners.mean(axis=1) - source.bounds_world[0]) / 16.0).astype(int)
    _, cell = np.unique(cells, axis=0, return_inverse=True)
    shares = np.bincount(cell.reshape(-1), chosen) / np.bincount(cell.reshape(-1))
    assert set(np.unique(shares)) == {0.0, 1.0}
    assert in_blocks(source, 1.0, 1.0).all() and not in_blocks(source, 1.0, 0.0).any()


def test_paths_that_have_an_error_are_found_between_bakes() -> None:
    errors = {4: 0.4, 8: 0.2, 16: 0.1, 64: 0.05}
    assert samples_of_error(errors, 0.1) == pytest.approx(16.0)
    assert samples_of_error(errors, 0.2 / 2**0.5) == pytest.approx(8 * 2**0.5)
    assert samples_of_error(errors, 0.0707107) == pytest.approx(32.0, rel=1e-4), "half as steep"
    assert samples_of_error(errors, 0.01) is None and samples_of_error({4: 0.4}, 0.1) is None
