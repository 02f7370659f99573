# SPDX-License-Identifier: GPL-3.0-or-later
"""Fragments that are kept, or cut again: the same octree, and the same parts."""

from dataclasses import fields

import numpy as np
import pytest

from patchnet.patchnet_addon.light.sheets import Sheets
from patchnet.patchnet_addon.lod.fit import leaf_keys_of
from patchnet.patchnet_addon.octree import voxelize as voxelizer
from patchnet.patchnet_addon.octree.build import build_clipped
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.leaf_levels import LeafLevels
from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.patchnet_addon.octree.voxelize import ClippedSurface, LeafDetail
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.mesh import Fragments, Shading, TriangleBatch, TriangleMesh
from patchnet.tests.references.clip import each_fragment

from .light_samples import random_layout, random_surface
from .mesh_samples import even, octree_of

GRID = Grid((0.0, 0.0, 0.0), 1.0, 5)
KEPT, IN_PASSES, CUT_AGAIN = {}, {"block_fragments": 500}, {"block_fragments": 500, "keep_bytes": 0}
WAYS = pytest.mark.parametrize("settings", [KEPT, IN_PASSES, CUT_AGAIN], ids=["kept", "passes", "again"])


@pytest.fixture(scope="module")
def surface() -> tuple[TriangleMesh, Sheets]:
    return random_surface(7)


def pieces(clipped: ClippedSurface) -> list[tuple]:
    return sorted(
        (
            fragments.level,
            key,
            number,
            float(fragments.area_world[f]),
            *fragments.barycentric[f].tolist(),
        )
        for _, fragments, f, key, number in each_fragment(clipped)
    )


def assert_same(one: Octree, other: Octree) -> None:
    for entry in fields(Octree):
        np.testing.assert_equal(getattr(one, entry.name), getattr(other, entry.name), entry.name)


@WAYS
@pytest.mark.parametrize("layout", [None, random_layout(7)], ids=["even", "layout"])
def test_octrees_have_the_same_bits(
    surface: tuple[TriangleMesh, Sheets], layout: LeafLevels | None, settings: dict
) -> None:
    """Also after another walk over the same fragments, which a shade of another light follows."""
    source, sheets = surface
    detail = LeafDetail(boxes=True, sides=True)

    def shade(batch: TriangleBatch, fragments: Fragments) -> Shading:
        return even()(batch, fragments)._replace(lit=sheets.of(batch).lit)

    expected = octree_of(source, shade, GRID, layout=layout, exposure=1.0, detail=detail)
    clipped = ClippedSurface(source, GRID, layout, **settings)
    assert (len(clipped.passes) > 1) == (settings is not KEPT)
    keys = drain(leaf_keys_of(clipped, even()))
    assert sum(map(len, keys.values())) == (expected.child_mask == 0).sum()
    for _ in range(2):
        assert_same(drain(build_clipped(clipped, shade, exposure=1.0, detail=detail)), expected)


@WAYS
def test_parts_are_the_fragments_of_one_cut(surface: tuple[TriangleMesh, Sheets], settings: dict) -> None:
    source, _ = surface
    layout = random_layout(7)
    expected = pieces(ClippedSurface(source, GRID, layout, keep_bytes=0))
    assert len(expected) == len({piece[1:3] for piece in expected}) > 900
    clipped = ClippedSurface(source, GRID, layout, **settings)
    assert pieces(clipped) == expected
    drain(leaf_keys_of(clipped, even()))
    assert pieces(clipped) == expected


@pytest.mark.parametrize("settings", [KEPT, IN_PASSES], ids=["kept", "passes"])
def test_what_is_kept_is_not_cut_again(
    surface: tuple[TriangleMesh, Sheets], monkeypatch: pytest.MonkeyPatch, settings: dict
) -> None:
    clipped = ClippedSurface(surface[0], GRID, **settings)
    drain(leaf_keys_of(clipped, even()))
    monkeypatch.setattr(voxelizer, "clip_batch", None)
    assert pieces(clipped)
