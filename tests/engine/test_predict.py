# SPDX-License-Identifier: GPL-3.0-or-later
"""Predictions by the compiled decoder against NumPy's."""

from types import SimpleNamespace

import numpy as np
import pytest

from patchnet.patchnet_addon.codes.encode import encode_octree
from patchnet.patchnet_addon.codes.predict import MEAN_SIZE, CornerCodes, predict, write_mean_code
from patchnet.patchnet_addon.network.compiled_layers import TILE
from patchnet.patchnet_addon.network.kinds import KINDS, PAPER
from patchnet.patchnet_addon.network.weights import Weights, load_weights
from patchnet.patchnet_addon.runtime.kernels import kernel
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.runtime.threads import limit_threads
from patchnet.tests.engine.octree_samples import random_octree, with_boxes, with_sides
from patchnet.tests.references.codes import corners_of, interpolate_codes_reference, predict_reference

TOLERANCE = 1e-5  # the order of additions differs, and the reference interpolates in float64


@pytest.fixture(scope="module", params=["random", "shipped", "mixture-1", "mixture-2-48", "mixture-2-78", "mixture-3"])
def coded(request):
    name, lookahead, width = (*request.param.split("-"), "", "")[:3]
    if name == "shipped":
        weights = load_weights()
    else:
        kind = KINDS.get(name, PAPER)
        kind = kind.of_width(int(width or kind.width))
        weights = Weights.random(seed=9, bias=0.1, lookahead=int(lookahead or 2), kind=kind)
    octree = with_sides(with_boxes(random_octree(seed=8, depth=5, count=500, adaptive=True)))
    return drain(encode_octree(octree, weights))


def sample_hits(coded, count, seed=1, *, seeing=None):
    """Pixels that hit any node, or none; `seeing`: all with look-ahead, or none."""
    random = np.random.default_rng(seed)
    nodes = np.arange(-1, coded.octree.node_count)
    if seeing is not None:
        nodes = nodes[coded.octree.look_ahead(coded.weights.lookahead)[nodes] == seeing]
    node = random.choice(nodes, count)
    direction = random.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    up = np.cross(direction, [0.3, 0.5, 0.8])
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    return SimpleNamespace(
        node=node,
        entry_voxel=random.uniform(size=(count, 3)).astype(np.float32),
        direction=direction.astype(np.float32),
        up=up.astype(np.float32),
        ratio=random.uniform(0.5, 1, count).astype(np.float32),
        luminance=np.where(node >= 0, coded.octree.luminance_float(node), np.float32(0.25)),
    )


def check(coded, hits):
    prediction, wanted = predict(coded, hits), predict_reference(coded, hits)
    np.testing.assert_array_equal(prediction.look_ahead, wanted.look_ahead)
    for ours, reference in ((prediction.coverage, wanted.coverage), (prediction.luminance, wanted.luminance)):
        assert ours.dtype == reference.dtype == np.float32
        np.testing.assert_allclose(ours, reference, atol=TOLERANCE, rtol=0)
    blind = ~prediction.look_ahead
    assert (prediction.coverage[blind] == 1).all()
    np.testing.assert_array_equal(prediction.luminance[blind], hits.luminance[blind])
    return prediction


@pytest.mark.parametrize("count", [0, 1, 7, TILE - 1, TILE, TILE + 1, 5 * TILE + 3, 9000])
def test_prediction_is_numpys(coded, count):
    check(coded, sample_hits(coded, count))


def test_octree_without_codes():
    shallow = drain(encode_octree(random_octree(depth=1, count=5), Weights.random()))
    assert not check(shallow, sample_hits(shallow, 100)).look_ahead.any()


def test_a_pixel_has_the_same_bits_in_any_company_and_number_of_threads(coded):
    hits = sample_hits(coded, 1000, seeing=True)
    whole = predict(coded, hits)
    part = SimpleNamespace(**{name: array[337:338] for name, array in vars(hits).items()})
    assert predict(coded, part).coverage[0] == whole.coverage[337]
    assert predict(coded, part).luminance[0] == whole.luminance[337]
    with limit_threads(1):
        other = predict(coded, hits)
    np.testing.assert_array_equal(other.coverage, whole.coverage)
    np.testing.assert_array_equal(other.luminance, whole.luminance)


def test_mean_of_codes(coded):
    random = np.random.default_rng(0)
    rows = random.integers(0, coded.coded_count, 100)
    points = random.uniform(size=(100, 3)).astype(np.float32)
    points[:4] = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 0, 1)]
    means = mean_codes(coded, rows, points)
    np.testing.assert_allclose(means, interpolate_codes_reference(coded, rows, points), atol=1e-5, rtol=1e-5)
    wanted = coded.codes[corners_of(coded.corner_rows, rows[:4])[np.arange(4), [0, 1, 2, 5]]]
    np.testing.assert_array_equal(means[:4], wanted.astype(np.float32))


@kernel
def write_means(halves, table, rows, points, means):
    for index in range(len(rows)):
        point = points[index, 0], points[index, 1], points[index, 2]
        write_mean_code(halves, table, rows[index], point, means[index])


def mean_codes(coded, rows, points):
    means = np.empty((len(rows), MEAN_SIZE), np.float32)
    codes = CornerCodes.of(coded)
    write_means(codes.halves, codes.rows, np.asarray(rows), points, means)
    return np.concatenate([means[:, :8], means[:, 14:]], axis=1)


def test_half_floats_of_every_size():
    """All finite half floats, subnormal ones and zeros of both signs too, at a corner: exactly."""
    halves = np.arange(1 << 16, dtype=np.uint16).view(np.float16)
    halves = np.append(halves[np.isfinite(halves)], np.zeros(2, np.float16))
    codes = np.resize(halves, (-(-len(halves) // 10), 10))
    table = np.arange(len(codes), dtype=np.uint32)[:, None] * np.array([1, 1, 0], np.uint32)
    there = np.vstack([codes, np.zeros((1, 10), np.float16)])  # the corner at x + 1 of the last voxel
    coded = SimpleNamespace(codes=there, corner_rows=table, nodes=None)
    points = np.zeros((len(codes), 3), np.float32)
    np.testing.assert_array_equal(mean_codes(coded, np.arange(len(codes)), points), codes.astype(np.float32))
