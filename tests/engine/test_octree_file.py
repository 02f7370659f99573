# SPDX-License-Identifier: GPL-3.0-or-later
"""Octree files: round trips, damage and contradictions; depth by memory and look-ahead."""

import os
from dataclasses import replace

import numpy as np
import pytest

from patchnet.patchnet_addon.lod import memory as lod
from patchnet.patchnet_addon.lod.depth import coarse_octree
from patchnet.patchnet_addon.octree.file import load_octree, octree_arrays, octree_hash, save_octree
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.voxelize import LeafDetail
from patchnet.patchnet_addon.runtime.errors import MemoryEstimateError, OctreeFileError, SettingError
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.mesh import Shading, TriangleMesh

from .mesh_samples import octree_of

DEPTH = 3
OPTIONAL = ("chroma", "bright_nodes", "bright_colors", "leaf_box")


@pytest.fixture(scope="module", autouse=True)
def unsynchronized():
    """Hundreds of files, of which none need outlive a power cut."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda descriptor: None)
        yield


def shade(_batch, fragments):
    return Shading(fragments.barycentric[:, 0].copy(), np.ones(len(fragments), np.float32))


@pytest.fixture(scope="module")
def mesh():
    rng = np.random.default_rng(0)
    return TriangleMesh.from_arrays(rng.uniform(-1, 1, (80, 1, 3)) + rng.normal(size=(80, 3, 3)) * 0.1)


def color_shade(batch, fragments):
    """Three times as bright, so that there is light above white."""
    luminance, opacity, *_ = shade(batch, fragments)
    return Shading(3.0 * luminance, opacity, np.stack([luminance, opacity, 0.5 * opacity], axis=1))


@pytest.fixture(scope="module")
def plain(mesh):
    return octree_of(mesh, shade, DEPTH, exposure=0.5, provenance={"scene": "s"})


@pytest.fixture(scope="module")
def octree(mesh):
    """It has all that there may be: colour, light above white, boxes of leaves."""
    detail = LeafDetail(boxes=True)
    return octree_of(mesh, color_shade, DEPTH, exposure=1.0, provenance={"scene": "s"}, detail=detail)


@pytest.mark.parametrize("name", ["plain", "octree"])
def test_round_trip(name, tmp_path, request):
    octree = request.getfixturevalue(name)
    save_octree(octree, tmp_path / "o.safetensors")
    loaded = load_octree(tmp_path / "o.safetensors")
    arrays, found = octree_arrays(octree), octree_arrays(loaded)
    assert arrays.keys() == found.keys() and (set(OPTIONAL) <= arrays.keys()) == (name == "octree")
    for each, array in arrays.items():
        np.testing.assert_array_equal(array, found[each])
    assert (loaded.grid, loaded.exposure, loaded.provenance) == (octree.grid, octree.exposure, {"scene": "s"})
    assert octree_hash(loaded) == octree_hash(octree)


def with_mask(octree, node, mask):
    masks = octree.child_mask.copy()
    masks[node] = mask
    return {"child_mask": masks, "leaf_box": None}


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (lambda o: {"first_child": np.where(o.child_mask > 0, o.first_child + 1, 0).astype(np.uint32)}, "child index"),
        (lambda o: {"first_child": np.zeros_like(o.first_child)}, "child index"),
        (lambda o: {"child_mask": np.full_like(o.child_mask, 255)}, "its children do not add up to its nodes"),
        (lambda o: with_mask(o, -1, 255), "its children do not add up to its nodes"),
        (lambda o: {"level_start": o.level_start + (np.arange(DEPTH + 2) == DEPTH), "leaf_box": None}, "of a level"),
        (lambda o: {"level_start": o.level_start[::-1].copy()}, "levels do not add up"),
        (lambda o: {"level_start": o.level_start[:-1].copy()}, "levels do not add up"),
        (lambda o: {"luminance": o.luminance[:-1]}, "differ in length"),
        (lambda o: {"chroma": o.chroma[:-1]}, "differ in length"),
        (lambda o: {"chroma": o.chroma.reshape(-1)}, "differ in length"),
        (lambda o: {"chroma": o.chroma.astype(np.uint16)}, "'chroma'"),
        (lambda o: {"bright_nodes": o.bright_nodes[::-1].copy()}, "out of order"),
        (lambda o: {"bright_nodes": o.bright_nodes + np.uint32(o.node_count)}, "out of order"),
        (lambda o: {"bright_colors": o.bright_colors[1:].copy()}, "differ in length"),
        (lambda o: {"leaf_box": o.leaf_box[1:]}, "differ in length"),
    ],
)
def test_inconsistent_octrees_are_refused(octree, tmp_path, change, cause):
    path = tmp_path / "bad.safetensors"
    save_octree(replace(octree, **change(octree)), path)
    with pytest.raises(OctreeFileError, match=cause) as caught:
        load_octree(path)
    assert "bad.safetensors" in str(caught.value)


def test_depth_is_bounded_by_memory(mesh):
    coarse = drain(coarse_octree(mesh))
    lod.check_memory(lod.expected_leaves(coarse, 8), 8, 50_000_000)
    with pytest.raises(MemoryEstimateError, match=r"Depth 14 needs about [\d.]+ GiB"):
        lod.check_memory(lod.expected_leaves(coarse, 14), 14, 50_000_000)
    with pytest.raises(MemoryEstimateError, match=r"and the memory limit is 1\.0 MiB: choose"):
        lod.check_memory(lod.expected_leaves(coarse, 9), 9, 2**20)


def test_estimate_is_near_the_truth(mesh):
    coarse = drain(coarse_octree(mesh))
    octree = octree_of(mesh, shade, 9)
    leaves = lod.expected_leaves(coarse, 9)
    assert leaves == pytest.approx(octree.leaf_count, rel=0.25)
    assert lod.stored_bytes(leaves) == pytest.approx(octree.nbytes, rel=0.25)


@pytest.mark.parametrize("contents", [lod.Contents(), lod.Contents(color=True), lod.Contents(True, True, True)])
@pytest.mark.parametrize("memory", [0, 1e6, 1e9, 2.5e9, 4e9, 8e9, 1e11])
def test_most_leaves_is_the_inverse_of_peak_bytes(memory, contents):
    leaves = lod.max_leaves(memory, contents)
    assert lod.peak_bytes(leaves, contents) <= memory < lod.peak_bytes(leaves + 2, contents)


def test_voxel_size_sets_side_and_depth(mesh):
    grid = Grid.with_voxel_size(mesh.bounds_world, 0.03)
    assert grid.voxel_size_world == pytest.approx(0.03)
    assert grid.side_world / 2 < np.ptp(mesh.bounds_world, axis=0).max() <= grid.side_world
    with pytest.raises(SettingError, match="positive"):
        Grid.with_voxel_size(mesh.bounds_world, 0.0)
    with pytest.raises(SettingError, match="1 to 18"):
        Grid.around(mesh.bounds_world, 19)
