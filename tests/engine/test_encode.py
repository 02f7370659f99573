# SPDX-License-Identifier: GPL-3.0-or-later
"""Codes of whole octrees against encoding corner by corner, and their file."""

from dataclasses import replace

import numpy as np
import pytest

from patchnet.patchnet_addon.codes.encode import encode_octree, make_encoder
from patchnet.patchnet_addon.codes.file import load_codes, save_codes
from patchnet.patchnet_addon.codes.octree_cache import CachedOctree, OctreeCache
from patchnet.patchnet_addon.network.encoders import MLP
from patchnet.patchnet_addon.network.kinds import KINDS, MIXTURE
from patchnet.patchnet_addon.network.weights import Weights
from patchnet.patchnet_addon.runtime.errors import CodesFileError
from patchnet.patchnet_addon.runtime.files import read_arrays, write_arrays
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.tests.engine.octree_samples import dense_cells, random_octree
from patchnet.tests.references.codes import coded_rows_reference, corners_of
from patchnet.tests.references.lookups import face_luminances
from patchnet.tests.references.networks import NumpyEncoder, run_layers

HALF = 2.0**-11  # relative rounding of a half float


@pytest.fixture(scope="module")
def weights():
    return Weights.random(seed=9, bias=0.1)


@pytest.fixture(scope="module", params=[False, True], ids=["uniform", "adaptive"])
def octree(request):
    return random_octree(seed=8, depth=5, count=500, adaptive=request.param)


@pytest.fixture(scope="module")
def coded(octree, weights):
    return drain(encode_octree(octree, weights))


def test_every_corner_has_the_code_of_its_patch(coded, octree, weights):
    rows = coded_rows_reference(octree, 2)
    for level in range(octree.depth + 1):
        dense = np.pad(dense_cells(octree, level + 2), ((4, 4), (4, 4), (4, 4), (0, 0)))
        for offset, cell in enumerate(octree.cells(level)):
            node = int(octree.level_start[level]) + offset
            row = rows[node]
            if row < 0 or offset % 7:
                continue
            for octant, corner in enumerate(corners_of(coded.corner_rows, row)):
                x, y, z = 4 * (cell + [octant & 1, octant >> 1 & 1, octant >> 2])
                patch = dense[z : z + 8, y : y + 8, x : x + 8].reshape(1, -1).astype(np.float64)
                (wanted,) = run_layers(weights.encoder, patch)
                np.testing.assert_allclose(coded.codes[corner], wanted, rtol=HALF, atol=1e-4)


@pytest.mark.parametrize("width", [64, 320])
def test_encoders_of_other_widths(octree, width):
    weights = Weights.random(seed=9, bias=0.1, encoder=MLP.of_width(width))
    wanted = drain(encode_octree(octree, weights, encoder=NumpyEncoder(weights))).codes
    found = drain(encode_octree(octree, weights)).codes
    np.testing.assert_allclose(found, wanted, rtol=2 * HALF, atol=1e-4)


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_luminance_changes_the_codes_of_the_paper_alone(octree, kind):
    """A mixture sees shape alone, and the compiled encoder takes no products of what it does not see."""
    weights = Weights.random(seed=9, bias=0.1, kind=kind)
    assert make_encoder(weights).sees_luminance != kind.mixes
    darker = replace(octree, luminance=octree.luminance // 2)
    codes, of_darker = (drain(encode_octree(each, weights)).codes for each in (octree, darker))
    assert np.array_equal(codes, of_darker) == kind.mixes
    wanted = drain(encode_octree(octree, weights, encoder=NumpyEncoder(weights))).codes
    np.testing.assert_allclose(codes, wanted, rtol=2 * HALF, atol=1e-4)


def test_codes_file(coded, octree, weights, tmp_path):
    path = tmp_path / "codes.safetensors"
    save_codes(coded, path)
    loaded = load_codes(path, octree, weights)
    np.testing.assert_array_equal(loaded.codes, coded.codes)
    np.testing.assert_array_equal(loaded.corner_rows, coded.corner_rows)
    index = coded.nbytes - coded.codes.nbytes - (0 if coded.corner_cells is None else coded.corner_cells.nbytes)
    assert index <= 13 * coded.coded_count + 64 and loaded.nbytes == coded.nbytes
    with pytest.raises(CodesFileError, match=r"codes\.safetensors belongs to another octree"):
        load_codes(path, random_octree(seed=1), weights)
    with pytest.raises(CodesFileError, match=r"codes\.safetensors was made with other weights"):
        load_codes(path, octree, Weights.random(1))
    arrays, metadata = read_arrays(path, "codes")
    moved = arrays["corner_rows"] + np.array([0, 1, 0], np.uint32)
    for rows in (moved, arrays["corner_rows"][:-1], arrays["corner_rows"].astype(np.int32)):
        write_arrays(path, {**arrays, "corner_rows": rows}, metadata, "codes")
        with pytest.raises(CodesFileError, match="damaged"):
            load_codes(path, octree, weights)
    for version, age in ((1, "older"), (2, "older"), (4, "newer")):
        write_arrays(path, arrays, metadata | {"codes_version": version}, "codes")
        with pytest.raises(CodesFileError, match=f"{age} PatchNet .codes version {version}, .*precompute the codes"):
            load_codes(path, octree, weights)


def test_codes_file_of_a_mixture(octree, tmp_path):
    """It holds what is mixed around corners, which follows the light, and is refused without."""
    mixture, path = Weights.random(2, kind=MIXTURE), tmp_path / "mixture.safetensors"
    coded = drain(encode_octree(octree, mixture))
    save_codes(coded, path)
    np.testing.assert_array_equal(load_codes(path, octree, mixture).corner_cells, coded.corner_cells)
    arrays, metadata = read_arrays(path, "codes")
    around = arrays.pop("corner_cells")
    for wrong in (arrays, arrays | {"corner_cells": around[1:]}):
        write_arrays(path, wrong, metadata, "codes")
        with pytest.raises(CodesFileError, match="damaged"):
            load_codes(path, octree, mixture)
    darker = drain(encode_octree(replace(octree, luminance=octree.luminance // 2), mixture))
    there = coded.corner_cells > 0
    np.testing.assert_array_equal(darker.corner_cells & 255, coded.corner_cells & 255)
    brighter, halved = face_luminances(coded.corner_cells)[there], face_luminances(darker.corner_cells)[there]
    assert np.abs(halved - brighter / 2).mean() < 0.02  # 15 steps of differences are coarse ones


def test_a_kept_octree_stays_when_its_codes_cannot_be_read(coded, octree, weights, tmp_path):
    """As after an update of the extension: light takes minutes to bake, codes take seconds."""
    cache, key = OctreeCache(tmp_path, 1 << 30), "0" * 32
    assert cache.save(key, CachedOctree(octree, coded))
    path = tmp_path / key / "codes.safetensors"
    arrays, metadata = read_arrays(path, "codes")
    write_arrays(path, arrays, {name: value for name, value in metadata.items() if name != "codes_version"}, "codes")
    entry = cache.load(key, weights)
    assert entry is not None and entry.coded is None and entry.octree.node_count == octree.node_count
