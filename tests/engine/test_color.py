# SPDX-License-Identifier: GPL-3.0-or-later
"""Colour in octrees: luminance keeps its bits, inner nodes are exact means."""

import numpy as np
import pytest

from patchnet.patchnet_addon.octree.accumulate import LeafAccumulator
from patchnet.patchnet_addon.octree.file import octree_arrays
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.leaf_levels import LeafLevels
from patchnet.patchnet_addon.surface.chroma import BLUE, GREEN, RED, decoded_colors
from patchnet.patchnet_addon.surface.chroma_kernels import encode_chroma
from patchnet.patchnet_addon.surface.mesh import Fragments, Shading, TriangleBatch, TriangleMesh
from patchnet.tests.references.small import encoded_chroma_reference

from .mesh_samples import in_batches, octree_of

WEIGHTS = np.array([RED, GREEN, BLUE])
GRID = Grid((-1.5, -1.5, -1.5), 3.0, 6)


def soup(order: np.ndarray, cuts: list[int]) -> TriangleMesh:
    """The same 150 triangles in any order and batches; a triangle's material is its number."""
    rng = np.random.default_rng(0)
    corners = rng.uniform(-1, 1, (150, 1, 3)) + rng.normal(size=(150, 3, 3)) * rng.uniform(0.01, 0.15, (150, 1, 1))
    return TriangleMesh(in_batches(corners[order], cuts, materials=order.astype(np.int32)))


def colors_of(batch: TriangleBatch, fragments: Fragments) -> np.ndarray:
    """A colour of its own for each triangle, that changes over it."""
    tones = np.random.default_rng(1).random((150, 3)) ** 2
    tones[7] = 0.0
    weight = 0.5 + fragments.barycentric[:, :1]
    return (tones[batch.materials[fragments.triangle]] * weight).astype(np.float32)


def gray_shade(batch: TriangleBatch, fragments: Fragments) -> Shading:
    opacity = (0.2 + 0.8 * fragments.barycentric[:, 1]).astype(np.float32)
    return Shading((colors_of(batch, fragments) @ WEIGHTS).astype(np.float32), opacity)


def color_shade(batch: TriangleBatch, fragments: Fragments) -> Shading:
    return gray_shade(batch, fragments)._replace(color=5.0 * colors_of(batch, fragments))  # brightness does not count


def test_chroma_keeps_luminance_and_hue() -> None:
    rng = np.random.default_rng(0)
    colors = rng.random((20_000, 3)) * 10.0 ** rng.uniform(-6, 6, (20_000, 1))
    luminance = colors @ WEIGHTS
    found = decoded_colors(luminance, encoded_chroma_reference(colors))
    np.testing.assert_allclose(found @ WEIGHTS, luminance, rtol=1e-6)
    assert np.abs(found / found.sum(axis=1, keepdims=True) - colors / colors.sum(axis=1, keepdims=True)).max() < 0.0041
    gray = np.array([[0.25, 0.25, 0.25], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(decoded_colors(gray[:, 0], encoded_chroma_reference(gray)), gray, rtol=1e-6)
    every = np.stack(np.meshgrid(np.arange(256), np.arange(256)), axis=-1).reshape(-1, 2).astype(np.uint8)
    any_bytes = decoded_colors(np.ones(len(every)), every)
    assert np.isfinite(any_bytes).all() and (any_bytes >= 0.0).all()


def test_compiled_chroma_equals_the_plain_one() -> None:
    colors = np.random.default_rng(0).random((20_000, 3)).astype(np.float32)
    colors[:2] = 0.0
    luminance = (colors.astype(np.float64) @ WEIGHTS).astype(np.float32)
    difference = encode_chroma(luminance, colors[:, ::2]).astype(int) - encoded_chroma_reference(colors)
    assert np.abs(difference).max() <= 1 and (difference == 0).mean() > 0.999, "single precision may tip a rounding"


def test_luminance_is_that_of_an_octree_without_colour() -> None:
    source = soup(np.arange(150), [])
    gray, octree = (octree_of(source, shade, GRID, exposure=1.5) for shade in (gray_shade, color_shade))
    assert gray.chroma is None and octree.chroma is not None and octree.chroma.any()
    for name, values in octree_arrays(gray).items():
        if name != "bright_colors":
            np.testing.assert_array_equal(values, octree_arrays(octree)[name], err_msg=name)
    np.testing.assert_allclose(octree.bright_colors @ WEIGHTS, gray.bright_colors[:, 0], rtol=1e-5)
    everything = slice(None)
    np.testing.assert_allclose(octree.color_float(everything) @ WEIGHTS, octree.luminance_float(everything), atol=1e-6)
    np.testing.assert_array_equal(gray.color_float(everything)[:, 1], gray.luminance_float(everything))


@pytest.mark.parametrize("bits", [12, 30], ids=["many in a leaf", "thousands of new bricks at once"])
def test_leaves_hold_means_over_their_surface(bits: int) -> None:
    """Against a plain sum over fragments; luminance of any size, and what is no number, is gray."""
    rng = np.random.default_rng(6)
    count = 30_000
    keys, areas = rng.integers(0, 1 << bits, count).astype(np.uint64), rng.uniform(0, 1e-6, count)
    color = (rng.random((count, 3)) * 10.0 ** rng.uniform(-3, 6, (count, 1))).astype(np.float32)
    luminance = (color.astype(np.float64) @ WEIGHTS).astype(np.float32)
    luminance[4:7] = np.nan, np.inf, -np.inf
    color[:7] = [[np.nan] * 3, [np.inf] * 3, [0.0] * 3, [-1.0] * 3, *[[1.0] * 3] * 3]
    leaves = LeafAccumulator(1.0 / 1024)
    fragments = Fragments(keys, np.zeros(count, np.int32), np.zeros((count, 2), np.float32), areas)
    leaves.add(fragments, Shading(luminance, np.ones(count), 0.5 * color), np.array([[0.0, 0.0, 1.0]]))
    found = leaves.take(10)
    sums = found.sums
    luminance = np.clip(np.nan_to_num(luminance.astype(float), posinf=2.0**32, neginf=-(2.0**32)), -(2.0**32), 2.0**32)
    color[:7] = luminance[:7, None]
    expected, place = np.unique(keys, return_inverse=True)
    np.testing.assert_array_equal(found.keys, expected)
    np.testing.assert_allclose(sums.area, np.bincount(place, areas), rtol=1e-6)
    for values, total in (
        (luminance, sums.light),
        (color[:, 0], sums.red_blue[:, 0]),
        (color[:, 2], sums.red_blue[:, 1]),
    ):
        np.testing.assert_allclose(total, np.bincount(place, areas * values), rtol=1e-4)


@pytest.mark.parametrize("levels", [(6,), (4, 6)], ids=["uniform", "fitted"])
def test_inner_nodes_hold_area_weighted_means(levels: tuple[int, ...]) -> None:
    layout = LeafLevels(np.resize(np.array(levels, np.uint8), 8))
    octree = octree_of(soup(np.arange(150), []), color_shade, GRID, layout=layout, exposure=1.5)
    colors = octree.color_float(slice(None)).astype(np.float64)
    area = octree.area_world.astype(np.float64)
    for node in np.flatnonzero(octree.child_mask):
        first = int(octree.first_child[node])
        children = slice(first, first + int(octree.child_mask[node]).bit_count())
        mean = area[children] @ colors[children] / area[children].sum()
        if mean.sum() > 1e-3:  # darker ones have few steps of luminance
            found = colors[node] / colors[node].sum()
            assert np.abs(found - mean / mean.sum()).max() < 0.006, (node, found, mean)
    leaf = octree.child_mask == 0
    whole = area[leaf] @ colors[leaf] / area[leaf].sum()
    np.testing.assert_allclose(colors[0], whole, rtol=0.02)
