# SPDX-License-Identifier: GPL-3.0-or-later
"""Look-aheads of 1, 2 and 3 levels: patches, codes, the exact oracle, the contract and files; 2 is what it was."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from patchnet.patchnet_addon.codes.encode import encode_octree
from patchnet.patchnet_addon.codes.exact import exact_prediction
from patchnet.patchnet_addon.codes.file import load_codes, save_codes
from patchnet.patchnet_addon.codes.patch_rays import PatchRays, render_patches
from patchnet.patchnet_addon.codes.patches import voxel_blocks
from patchnet.patchnet_addon.codes.predict import predict
from patchnet.patchnet_addon.lod.depth import coarse_octree, expected_share, wanted_depth
from patchnet.patchnet_addon.lod.detail import FINE_OFFSETS, lookahead_share, needed_levels
from patchnet.patchnet_addon.lod.fit import fit_leaf_levels
from patchnet.patchnet_addon.network.weights import Weights, load_weights, network, save_weights
from patchnet.patchnet_addon.octree.build import build_octree
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.runtime.errors import SettingError, WeightsFileError
from patchnet.patchnet_addon.runtime.files import content_hash, write_arrays
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.sampling.registry import STRATEGIES
from patchnet.patchnet_addon.sampling.trace import trace_view
from patchnet.patchnet_addon.surface.mesh import TriangleMesh
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.patchnet_addon.tracing.render import first_hits, patch_hits
from patchnet.tests.engine.octree_samples import dense_cells, random_octree, with_boxes
from patchnet.tests.references.codes import corner_blocks_reference, voxel_blocks_reference
from patchnet.tests.references.first_hits import first_hits_reference, needed_levels_reference
from patchnet.tests.references.lookups import brick_nodes

LOOKAHEADS = [1, 2, 3]
HALF = 2.0**-11  # relative rounding of a half float
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


def seen_by_4096_rays(octree, hits, pixel, lookahead):
    """Coverage and luminance by the slab test of each ray against all cubes around the voxel, in float64."""
    level, cell, fine = int(hits.level[pixel]), hits.cell[pixel].astype(int), 2**lookahead
    dense = np.pad(dense_cells(octree, level + lookahead), [(fine, fine)] * 3 + [(0, 0)])
    z, y, x = (slice(fine * cell[axis], fine * (cell[axis] + 3)) for axis in (2, 1, 0))
    patch = dense[z, y, x]
    there = np.argwhere(patch[..., 0] > 0)[:, ::-1] / fine - 1.0  # lowest corners in voxels, x y z
    luminance = patch[patch[..., 0] > 0][:, 1]
    direction, up = hits.direction[pixel].astype(np.float64), hits.up[pixel].astype(np.float64)
    axes = np.stack([np.cross(direction, up), up])
    along = ((np.arange(64) + 0.5) / 64 - 0.5) * hits.ratio[pixel]
    inside = np.abs((there + 0.5 / fine - hits.entry_voxel[pixel]) @ axes.T).max(1) < 0.5 + 1.8 / fine
    if not inside.any():
        return 0.0, 0.0
    there, luminance = there[inside], luminance[inside]
    hit, total = 0, 0.0
    for upward in along:
        origin = hits.entry_voxel[pixel] + along[:, None] * axes[0] + upward * axes[1]
        with np.errstate(divide="ignore", invalid="ignore"):
            first = (there - origin[:, None]) / direction
            second = (there + 1 / fine - origin[:, None]) / direction
        enter, leave = np.minimum(first, second).max(2), np.maximum(first, second).min(2)
        enter = np.where(enter <= leave, enter, np.inf)
        met = np.isfinite(enter).any(1)
        hit += met.sum()
        total += luminance[enter.argmin(1)][met].sum()
    return hit / 4096, total / max(hit, 1)


@pytest.mark.parametrize("lookahead", LOOKAHEADS)
def test_exact_oracle_equals_rays_through_every_cube(octree, camera, lookahead):
    """Leaves are whole here; boxes are those of `tests/training/test_patch_rays.py`."""
    octree = replace(octree, leaf_box=None)
    hits = first_hits(octree, camera)
    found = drain(exact_prediction(octree, hits, lookahead))
    ahead = np.zeros(octree.node_count, bool)
    for level in range(octree.depth + 1):
        ahead[octree.level(level)] = descendants(octree, level, lookahead)
    np.testing.assert_array_equal(found.look_ahead, hits.hit & ahead[np.maximum(hits.node, 0)])
    assert (found.coverage[~found.look_ahead] == 1).all()
    np.testing.assert_array_equal(found.luminance[~found.look_ahead], hits.luminance[~found.look_ahead])
    pixels = np.flatnonzero(found.look_ahead)
    assert len(pixels) > 20
    for pixel in pixels[:: len(pixels) // 12]:
        coverage, luminance = seen_by_4096_rays(octree, hits, pixel, lookahead)
        # A ray that grazes an edge may fall to either side: 3 of 4096.
        assert abs(found.coverage[pixel] - coverage) <= 3 / 4096
        if coverage > 0.01:
            assert abs(found.luminance[pixel] - luminance) < 2e-3


@pytest.mark.parametrize("lookahead", [0, 4, 1.5])
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
        blocks = voxel_blocks(octree, octree.find(level, cells), lookahead)
        np.testing.assert_array_equal(blocks, voxel_blocks_reference(octree, level, cells, lookahead))
        patches = corner_blocks_reference(octree, level, cells, lookahead)
        for block, patch, (x, y, z) in zip(blocks, patches, side * cells, strict=True):
            np.testing.assert_allclose(patch, dense[z : z + 2 * side, y : y + 2 * side, x : x + 2 * side], atol=1e-7)
            low = np.array([x, y, z]) + side
            wanted = dense[low[2] : low[2] + side, low[1] : low[1] + side, low[0] : low[0] + side]
            np.testing.assert_allclose(block, wanted, atol=1e-7)


@pytest.mark.parametrize("lookahead", [1, 3])
def test_codes_of_patches(octree, lookahead):
    weights, side = Weights.random(seed=9, bias=0.1, lookahead=lookahead), 2**lookahead
    coded = drain(encode_octree(octree, weights))
    for level in range(octree.depth + 1):
        ahead = descendants(octree, level, lookahead)
        np.testing.assert_array_equal(coded.rows_of(np.arange(octree.node_count))[octree.level(level)] >= 0, ahead)
        if not ahead.any():
            continue
        dense = np.pad(dense_cells(octree, level + lookahead), [(side, side)] * 3 + [(0, 0)])
        for place in np.flatnonzero(ahead)[::40]:
            row = coded.rows_of(octree.level_start[level] + place)
            for octant, corner in enumerate(coded.corners_of(row)):
                x, y, z = side * (octree.cells(level)[place] + [octant & 1, octant >> 1 & 1, octant >> 2])
                values = dense[z : z + 2 * side, y : y + 2 * side, x : x + 2 * side].reshape(-1).astype(np.float64)
                for matrix, bias in weights.encoder[:-1]:
                    values = np.maximum(matrix.astype(np.float64) @ values + bias, 0)
                values = weights.encoder[-1][0].astype(np.float64) @ values + weights.encoder[-1][1]
                np.testing.assert_allclose(coded.codes[corner], values, rtol=HALF, atol=2e-4)


def test_codes_file_is_as_deep_as_its_weights(octree, tmp_path):
    weights = Weights.random(lookahead=1)
    coded = drain(encode_octree(octree, weights))
    save_codes(coded, tmp_path / "c.safetensors")
    loaded = load_codes(tmp_path / "c.safetensors", octree, weights)
    np.testing.assert_array_equal(loaded.codes, coded.codes)
    assert coded.coded_count == octree.look_ahead(1).sum() > octree.look_ahead(2).sum()


@pytest.mark.parametrize("lookahead", LOOKAHEADS)
def test_weights_file_states_its_look_ahead(lookahead, tmp_path):
    path = tmp_path / "w.safetensors"
    save_weights(Weights.random(4, lookahead=lookahead), path)
    loaded = load_weights(path)
    assert loaded.lookahead == lookahead and loaded.hash == Weights.random(4, lookahead=lookahead).hash


def test_torch_model_has_the_look_ahead_of_its_weights():
    pytest.importorskip("torch")
    from patchnet.training.network.patchnet import PatchNet

    weights = Weights.random(4, lookahead=1)
    assert PatchNet(weights).to_weights().hash == weights.hash


def test_weights_file_that_does_not_say_looks_two_levels_ahead(tmp_path):
    path = tmp_path / "old.safetensors"
    stated = {name: value for name, value in network(2).items() if name != "look_ahead"}
    write_arrays(path, Weights.random().arrays(), {"network": stated}, "weights")
    assert load_weights(path).lookahead == 2
    assert load_weights().lookahead == 2  # the shipped weights, which do say


@pytest.mark.parametrize("stated", [0, 4, "2", None, True])
def test_unknown_look_ahead_of_a_weights_file(stated, tmp_path):
    path = tmp_path / "w.safetensors"
    write_arrays(path, Weights.random().arrays(), {"network": {**network(2), "look_ahead": stated}}, "weights")
    with pytest.raises(WeightsFileError, match=r"its 'look_ahead' is .* one of 1, 2, 3"):
        load_weights(path)


def test_arrays_of_another_look_ahead_than_stated(tmp_path):
    path = tmp_path / "w.safetensors"
    write_arrays(path, Weights.random(lookahead=1).arrays(), {"network": network(3)}, "weights")
    with pytest.raises(WeightsFileError, match=r"'encoder\.0\.weight' is float32 of shape \(256, 320\)"):
        load_weights(path)


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
    assert wanted_depth(octree, [camera], lookahead=lookahead) == max(
        wanted_depth(octree, [camera], lookahead=3) - 3 + lookahead, 5
    )
    assert expected_share(octree, [camera], 5, lookahead=lookahead) == expected_share(
        octree, [camera], 4, lookahead=lookahead - 1
    )


def shade(batch, fragments):
    return np.full(len(fragments), 0.5, np.float32), np.ones(len(fragments), np.float32)


@pytest.mark.parametrize("lookahead", [1, 3])
def test_depths_give_the_look_ahead_that_was_asked_for(lookahead):
    square = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float64)
    tent = square * [0.5, 0.5, 1] + [0, 0, 0.3] * np.array([[0], [0], [1], [1]])
    mesh = TriangleMesh.from_arrays(np.stack([*square[[[0, 1, 2], [0, 2, 3]]], *tent[[[0, 1, 2], [0, 2, 3]]]]))
    camera = Camera.look_at(np.array([1.0, -1.8, 1.2]), np.zeros(3), size_px=(96, 64))

    def share(depth, layout=None):
        octree = drain(build_octree(mesh, Grid.around(mesh.bounds_world, depth), shade, layout=layout))
        hits = first_hits(octree, camera)
        return octree.look_ahead(lookahead)[hits.node[hits.hit]].mean()

    depth = wanted_depth(drain(coarse_octree(mesh)), [camera], lookahead=lookahead)
    assert share(depth) >= 0.95 > share(depth - 1)
    fitted = drain(fit_leaf_levels(mesh, Grid.around(mesh.bounds_world, 9), [camera], shade, lookahead=lookahead))
    assert share(12, fitted.layout) > 0.99 and fitted.lookahead_share == 1.0


@pytest.mark.parametrize("lookahead", LOOKAHEADS)
def test_rays_behind_see_a_level_more_than_the_patch(octree, camera, lookahead):
    """Against the Reference of the walk, from where it restarts."""
    hits = first_hits(octree, camera)
    found = patch_hits(octree, camera, lookahead=lookahead).behind
    row, column = np.divmod(np.arange(camera.pixel_count), camera.width_px)
    x, y = 2 * (column + 0.5) / camera.width_px - 1, 2 * (row + 0.5) / camera.height_px - 1
    for pixel in np.flatnonzero(hits.hit)[::5]:
        restart = float(hits.t_world[pixel]) + 1.5 * 0.5 ** hits.level[pixel]
        speed = float(hits.z_world[pixel]) / float(hits.t_world[pixel])
        moved = Camera(**{**vars(camera), "clip_start": restart * speed})
        node, _ = first_hits_reference(octree, moved, x[[pixel]], y[[pixel]], 0.5 ** (lookahead + 1))
        assert found[pixel] == pytest.approx(octree.luminance_float(node)[0] if node[0] >= 0 else 0.0, abs=1e-6)


def test_pixels_look_as_far_as_the_weights_of_its_codes(octree, camera):
    """Without codes two levels; what is asked for goes before both, but codes are what they are."""
    exact = [STRATEGIES[name] for name in ("patchnet-exact", "patchnet-behind-exact")]
    coded = drain(encode_octree(octree, Weights.random(lookahead=1)))
    for settings, lookahead in (({}, 2), ({"coded": coded}, 1), ({"lookahead": 3}, 3)):
        buffers = drain(trace_view(octree, camera, exact, reference=False, **settings))
        wanted = drain(exact_prediction(octree, buffers.hits, lookahead))
        np.testing.assert_array_equal(buffers.exact.coverage, wanted.coverage)
        np.testing.assert_array_equal(buffers.behind, patch_hits(octree, camera, lookahead=lookahead).behind)
        for strategy in exact:
            assert strategy.scores(buffers)[buffers.exact.look_ahead].max() > 0
    buffers = drain(trace_view(octree, camera, [STRATEGIES["patchnet"]], coded=coded, reference=False))
    np.testing.assert_array_equal(buffers.prediction.coverage, predict(coded, buffers.hits).coverage)
    np.testing.assert_array_equal(
        buffers.prediction.look_ahead, buffers.hits.hit & octree.look_ahead(1)[buffers.hits.node]
    )
    with pytest.raises(SettingError, match="look 1 levels ahead, not 3"):
        drain(trace_view(octree, camera, [STRATEGIES["patchnet"]], coded=coded, lookahead=3))


def exact_views():
    """Directions and ups (48, 3) with rational coordinates: the same bits everywhere."""
    pairs = [((1, 2, 2), (2, 1, -2), 3), ((2, 3, 6), (3, -6, 2), 7)]
    found = [
        [np.array(vector)[list(order)] * signs / length for vector in (direction, up)]
        for direction, up, length in pairs
        for order in itertools.permutations(range(3))
        for signs in [(1, 1, 1), (-1, 1, 1), (1, -1, 1), (-1, -1, -1)]
    ]
    return np.array(found, np.float32).transpose(1, 0, 2)


def values_of_two_levels(octree):
    """Results where no look-ahead is named: nothing of them goes through a BLAS, whose bits differ."""
    levels = range(octree.depth - 1)
    blocks = [voxel_blocks(octree, np.arange(*octree.level_start[level : level + 2])) for level in levels]
    direction, up = exact_views()
    voxels = octree.cells(3)[:: len(octree.cells(3)) // 6][:6]
    entry = np.linspace(0, 1, 3 * len(direction)).reshape(-1, 3)[:, [0, 2, 1]]
    ratio = np.linspace(0.5, 1, len(direction))
    rays = PatchRays(np.full(6, 3), voxels, np.arange(7) * 8, entry, direction, up, ratio)
    coverage, luminance = render_patches(octree, rays)
    return {
        "ahead": octree.look_ahead(),
        "bricks": np.stack([brick_nodes(octree, 3, cell) for cell in voxels]),
        "blocks": np.concatenate(blocks),
        "coverage": coverage,
        "luminance": luminance,
    }


BEFORE = {
    False: {
        "ahead": "0ea2545505368e3321fc7520af58ff34",
        "bricks": "2afd6eb0adca166fd4b1c4b46fbc286c",
        "blocks": "5a7e2dc07d07518095ca63d4422be3d1",
        "coverage": "8f9c7766bdacb40bbd44cdd2394f5763",
        "luminance": "b1708414890eb203a4b874350b4cfa31",
    },
    True: {
        "ahead": "d0e467c6a3d98f19ba44bbf319772e71",
        "bricks": "d8dbdd5ad251c365788f479f96f177d7",
        "blocks": "3afbb4378823f39850a15c1c07f9580f",
        "coverage": "3e2a8ee1d87b362a637ae7774c0ea746",
        "luminance": "777518336eadb8842472bf79c32ceb87",
    },
}


@pytest.mark.parametrize("adaptive", [False, True])
def test_two_levels_have_the_bits_they_had(adaptive):
    """As they were when two levels were built in."""
    values = values_of_two_levels(random_octree(seed=5, depth=5, count=400, adaptive=adaptive))
    assert {name: content_hash({name: value}) for name, value in values.items()} == BEFORE[adaptive]
