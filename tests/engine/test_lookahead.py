# SPDX-License-Identifier: GPL-3.0-or-later
"""Look-aheads of 1, 2 and 3 levels: patches, exact prediction, contract, files."""

import numpy as np
import pytest

from patchnet.patchnet_addon.codes.brick import voxel_blocks
from patchnet.patchnet_addon.codes.encode import encode_octree
from patchnet.patchnet_addon.codes.patch_rays import exact_prediction
from patchnet.patchnet_addon.codes.predict import predict
from patchnet.patchnet_addon.lod.depth import expected_share
from patchnet.patchnet_addon.lod.fit import fit_leaf_levels, lookahead_share, needed_levels
from patchnet.patchnet_addon.lod.stops import FINE_OFFSETS
from patchnet.patchnet_addon.network.weights import Weights, load_weights, network
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.patchnet_addon.runtime.files import write_arrays
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.sampling.registry import STRATEGIES
from patchnet.patchnet_addon.sampling.trace import trace_view
from patchnet.patchnet_addon.surface.mesh import TriangleMesh
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.patchnet_addon.tracing.render import first_hits
from patchnet.patchnet_addon.tracing.supersample import behind_patches
from patchnet.tests.engine.mesh_samples import even, octree_of, square
from patchnet.tests.engine.octree_samples import dense_cells, random_octree, with_boxes
from patchnet.tests.references.codes import corner_blocks_reference
from patchnet.tests.references.first_hits import needed_levels_reference
from patchnet.tests.references.lookups import node_at

LOOKAHEADS = [1, 2, 3]
DEPTH = 6


@pytest.fixture(scope="module", params=[False, True], ids=["uniform", "adaptive, with boxes"])
def octree(request):
    octree = random_octree(seed=12, depth=DEPTH, count=900, adaptive=request.param)
    return with_boxes(octree) if request.param else octree


@pytest.fixture(scope="module")
def camera():
    """From where voxels of levels 3 and 4 stop rays: they have descendants 1 and 2, some of them 3 levels down."""
    return Camera.look_at(np.array([1.9, -0.6, 1.3]), np.full(3, 0.5), size_px=(14, 12))


def descendants(octree, level, lookahead):
    """(n_level,) bool by comparing the cells of both levels."""
    if level + lookahead > octree.depth:
        return np.zeros(len(octree.keys(level)), bool)
    below = {tuple(cell) for cell in (octree.cells(level + lookahead) >> lookahead).tolist()}
    return np.array([tuple(cell) in below for cell in octree.cells(level).tolist()])


@pytest.mark.parametrize("lookahead", LOOKAHEADS)
def test_pixels_without_look_ahead_keep_what_they_show(octree, camera, lookahead):
    """What patches show is held against rays in `tests/training/test_patch_rays.py`."""
    hits = first_hits(octree, camera)
    found = drain(exact_prediction(octree, hits, lookahead))
    ahead = np.zeros(octree.node_count, bool)
    for level in range(octree.depth + 1):
        ahead[octree.level(level)] = descendants(octree, level, lookahead)
    np.testing.assert_array_equal(octree.look_ahead(lookahead), ahead)
    np.testing.assert_array_equal(found.look_ahead, hits.hit & ahead[np.maximum(hits.node, 0)])
    assert (found.coverage[~found.look_ahead] == 1).all()
    np.testing.assert_array_equal(found.luminance[~found.look_ahead], hits.luminance[~found.look_ahead])
    assert found.look_ahead.sum() > 20 and (found.coverage[found.look_ahead] < 0.9).any()


@pytest.mark.parametrize("lookahead", [0, 4])
def test_other_look_aheads_are_refused(octree, camera, lookahead):
    with pytest.raises(SettingError, match="Look-ahead"):
        drain(exact_prediction(octree, first_hits(octree, camera), lookahead))
    with pytest.raises(SettingError, match="Look-ahead"):
        Weights.random(lookahead=lookahead)


@pytest.mark.parametrize("lookahead", LOOKAHEADS)
def test_blocks_and_patches_are_cut_from_the_dense_grid(octree, lookahead):
    side = 2**lookahead
    for level in range(octree.depth - lookahead + 2):  # on the last one, the finest level lies below the octree
        dense = np.pad(dense_cells(octree, level + lookahead), [(side, side)] * 3 + [(0, 0)])
        cells = octree.cells(level)[::3]
        blocks = voxel_blocks(octree, node_at(octree, level, cells), lookahead)
        patches = corner_blocks_reference(octree, level, cells, lookahead)
        for block, patch, (x, y, z) in zip(blocks, patches, side * cells, strict=True):
            np.testing.assert_allclose(patch, dense[z : z + 2 * side, y : y + 2 * side, x : x + 2 * side], atol=1e-7)
            low = np.array([x, y, z]) + side
            wanted = dense[low[2] : low[2] + side, low[1] : low[1] + side, low[0] : low[0] + side]
            np.testing.assert_array_equal(block, wanted)


def test_weights_file_that_does_not_say_looks_two_levels_ahead(tmp_path):
    path = tmp_path / "old.safetensors"
    stated = {name: value for name, value in network(2).items() if name != "look_ahead"}
    write_arrays(path, Weights.random().arrays(), {"network": stated}, "weights")
    assert load_weights(path).lookahead == 2
    assert load_weights().lookahead == 2  # the shipped weights, which do say


@pytest.mark.parametrize("lookahead", LOOKAHEADS)
def test_contract(octree, camera, lookahead):
    """Look-ahead that is asked for, what there is, and the depth that gives it."""
    needed, pixels = np.zeros(8**3, np.uint8), np.zeros(8**3, np.uint32)
    seen = octree.nodes, octree.grid, camera
    drain(needed_levels(*seen, needed, pixels, lookahead=lookahead))
    wanted = needed_levels_reference(octree, camera, 3, np.array(FINE_OFFSETS), lookahead=lookahead)
    np.testing.assert_array_equal(needed, wanted)
    hits = first_hits(octree, camera)
    share = octree.look_ahead(lookahead)[hits.node[hits.hit]].mean()
    assert lookahead_share(*seen, lookahead=lookahead) == pytest.approx(share)
    assert expected_share(octree, [camera], 5, lookahead=lookahead) == expected_share(
        octree, [camera], 4, lookahead=lookahead - 1
    )


@pytest.mark.parametrize("lookahead", [1, 3])
def test_depths_give_the_look_ahead_that_was_asked_for(lookahead):
    slope = square(0, -0.5, 0.5)
    slope[..., 2] = 0.3 * (slope[..., 1] > 0)
    mesh = TriangleMesh.from_arrays(np.concatenate([square(0, -1, 1), slope]))
    camera = Camera.look_at(np.array([1.0, -1.8, 1.2]), np.zeros(3), size_px=(96, 64))

    fitted = drain(fit_leaf_levels(mesh, Grid.around(mesh.bounds_world, 9), [camera], even(), lookahead=lookahead))
    octree = octree_of(mesh, even(), 12, layout=fitted.layout)
    hits = first_hits(octree, camera)
    assert octree.look_ahead(lookahead)[hits.node[hits.hit]].mean() > 0.99 and fitted.lookahead_share == 1.0


def test_pixels_look_as_far_as_the_weights_of_its_codes(octree, camera):
    """Without codes two levels; what is asked for goes before both, but codes are what they are."""
    exact = [STRATEGIES[name] for name in ("patchnet-exact", "patchnet-behind-exact")]
    coded = drain(encode_octree(octree, Weights.random(lookahead=1)))
    for settings, lookahead in (({}, 2), ({"coded": coded}, 1), ({"lookahead": 3}, 3)):
        buffers = drain(trace_view(octree, camera, exact, reference=False, **settings))
        wanted = drain(exact_prediction(octree, buffers.hits, lookahead))
        np.testing.assert_array_equal(buffers.exact.coverage, wanted.coverage)
        behind = behind_patches(octree, camera, buffers.hits, lookahead=lookahead)
        np.testing.assert_array_equal(buffers.behind, behind.luminance)
        for strategy in exact:
            assert strategy.scores(buffers)[buffers.exact.look_ahead].max() > 0
    buffers = drain(trace_view(octree, camera, [STRATEGIES["patchnet"]], coded=coded, reference=False))
    np.testing.assert_array_equal(buffers.prediction.coverage, predict(coded, buffers.hits).coverage)
    np.testing.assert_array_equal(
        buffers.prediction.look_ahead, buffers.hits.hit & octree.look_ahead(1)[buffers.hits.node]
    )
    with pytest.raises(SettingError, match="look 1 levels ahead, not 3"):
        drain(trace_view(octree, camera, [STRATEGIES["patchnet"]], coded=coded, lookahead=3))
