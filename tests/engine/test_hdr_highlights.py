# SPDX-License-Identifier: GPL-3.0-or-later
"""Light above white in nodes and refined pixels; exposure without emitters."""

from dataclasses import replace

import numpy as np
import pytest

from patchnet.patchnet_addon.octree.leaf_levels import LeafLevels
from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.patchnet_addon.surface.chroma import REC709
from patchnet.patchnet_addon.surface.mesh import Fragments, Material, Shading, TriangleBatch, TriangleMesh
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.patchnet_addon.tracing.render import first_hits
from patchnet.patchnet_addon.tracing.supersample import supersample_pixels

from .mesh_samples import even, octree_of
from .test_color import GRID, soup

BRIGHTEST = 8.0


def mesh(materials: tuple[Material, ...] = (Material("default"),)) -> TriangleMesh:
    """150 triangles; of two materials, one in seven has the second."""
    (batch,) = soup(np.arange(150), []).parts
    kinds = (np.arange(150) % 7 == 0).astype(np.int32) if len(materials) > 1 else np.zeros(150, np.int32)
    return TriangleMesh((replace(batch, materials=kinds),), materials)


shade = even(BRIGHTEST * np.random.default_rng(1).random(150) ** 4)  # from 0 to BRIGHTEST, most below 1


def color_shade(batch: TriangleBatch, fragments: Fragments) -> Shading:
    tones = np.random.default_rng(2).random((150, 3)).astype(np.float32)
    return shade(batch, fragments)._replace(color=tones[fragments.triangle])


def octrees(colored: bool = False, mixed: bool = False) -> tuple[Octree, Octree]:
    """An octree with light above white, and the same with nothing clamped, its light divided by BRIGHTEST."""
    layout = None
    if mixed:
        levels = np.random.default_rng(3).choice([4, 6], 8**3).astype(np.uint8)
        layout = LeafLevels(levels)
    how = color_shade if colored else shade
    one, other = (octree_of(mesh(), how, GRID, layout=layout, exposure=value) for value in (1.0, 1.0 / BRIGHTEST))
    assert other.bright_nodes is None and one.bright_nodes is not None
    return one, other


@pytest.mark.parametrize("colored", [False, True])
@pytest.mark.parametrize("mixed", [False, True])
def test_nodes_hold_what_the_clamp_takes(colored: bool, mixed: bool) -> None:
    clamped, whole = octrees(colored, mixed)
    nodes = np.arange(clamped.node_count)
    above = clamped.color_above_white(nodes)
    light = clamped.luminance_float(nodes) + above @ REC709
    np.testing.assert_allclose(light, BRIGHTEST * whole.luminance_float(nodes), atol=BRIGHTEST / 65535)
    assert above[0].any(), "means over leaves have their light, too"
    assert 0.02 < len(clamped.bright_nodes) / len(nodes) < 0.6
    leaves = clamped.child_mask == 0
    # Hue has two bytes: a channel errs by about a fiftieth.
    together = clamped.color_float(nodes) + above
    np.testing.assert_allclose(together[leaves], BRIGHTEST * whole.color_float(nodes)[leaves], atol=0.02 * BRIGHTEST)
    assert not clamped.color_above_white(np.array([-1])).any()


def test_refined_pixels_have_it_and_their_luminance_has_not() -> None:
    camera = Camera.look_at(np.array([-3.0, -2.0, 1.5]), np.zeros(3), size_px=(24, 24))
    clamped, whole = octrees()
    pixels = np.flatnonzero(first_hits(clamped, camera).hit)
    for side in (1, 3, 32):
        found, truth = (supersample_pixels(octree, camera, pixels, side) for octree in (clamped, whole))
        np.testing.assert_allclose(found.colors, BRIGHTEST * truth.colors, atol=BRIGHTEST / 65535)
        plain = supersample_pixels(replace(clamped, bright_nodes=None, bright_colors=None), camera, pixels, side)
        np.testing.assert_array_equal(found.luminance, plain.luminance)
        np.testing.assert_array_equal(plain.colors[:, 0], plain.luminance)
        assert (found.colors[:, 0] > 1.5).any() and plain.colors.max() <= 1.0


# The first material from 0.1 to 0.5, the second 50.
lamp_shade = even(np.where(np.arange(150) % 7 == 0, 50.0, 0.1 + 0.4 * np.random.default_rng(1).random(150)))


@pytest.mark.parametrize(
    "emission, exposure", [(50.0, (2.0, 2.2)), (30.0, (2.0, 2.2)), (1.0, (0.0199, 0.0201)), (0.0, (0.0199, 0.0201))]
)
def test_emitters_take_no_part_in_the_exposure(emission: float, exposure: tuple[float, float]) -> None:
    """Of what shines by itself for the most part; what is merely lit so brightly does count."""
    lamp = Material("Lamp", emission=(emission,) * 3)
    octree = octree_of(mesh((Material("Wall"), lamp)), lamp_shade, GRID)
    assert exposure[0] <= octree.exposure <= exposure[1]
    again = octree_of(mesh((Material("Wall"), lamp)), lamp_shade, GRID, block_fragments=500)
    assert again.exposure == octree.exposure


def test_a_scene_of_emitters_alone_is_exposed_by_them() -> None:
    lamp = Material("Lamp", emission=(50.0,) * 3)
    octree = octree_of(mesh((lamp,)), lamp_shade, GRID)
    assert octree.exposure == pytest.approx(0.02)
