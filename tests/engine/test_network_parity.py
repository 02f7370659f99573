# SPDX-License-Identifier: GPL-3.0-or-later
"""The network with torch, without torch, and written naively in float64 from the definitions: one result."""

from dataclasses import replace

import numpy as np
import pytest

from patchnet.patchnet_addon.network.harmonics import real_harmonics
from patchnet.patchnet_addon.network.kinds import MIXTURE
from patchnet.patchnet_addon.network.weights import Weights, load_weights, network, save_weights
from patchnet.patchnet_addon.runtime.errors import WeightsFileError
from patchnet.patchnet_addon.runtime.files import write_arrays
from patchnet.tests.references.networks import MixtureInputs, NumpyEncoder, decode, decode_mixture

COUNT = 5000  # more than one block of the decoder
TOLERANCE = 1e-4


@pytest.fixture(scope="module")
def weights():
    return Weights.random(seed=5, bias=0.1)


@pytest.fixture(scope="module")
def pixels():
    """Codes (N, 10), direction, up (N, 3), ratio (N,) as rays bring them."""
    random = np.random.default_rng(2)
    direction = random.normal(size=(COUNT, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    up = np.cross(direction, random.normal(size=(COUNT, 3)))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    arrays = random.normal(size=(COUNT, 10)) * 2, direction, up, random.uniform(0.5, 1, COUNT)
    return tuple(array.astype(np.float32) for array in arrays)


def naive_layers(layers, values):
    """Rows one by one, in float64."""
    for index, (matrix, bias) in enumerate(layers):
        values = [matrix.astype(np.float64) @ row + bias for row in values]
        if index < len(layers) - 1:
            values = [np.where(row > 0, row, 0) for row in values]
    return np.array(values)


def naive_decode(weights, codes, direction, up, ratio):
    harmonics = real_harmonics(direction.astype(np.float64))
    rows = []
    for row in range(len(codes)):
        code = [codes[row, k] * harmonics[row, k] for k in range(9)] + [codes[row, 9]]
        rows.append(np.array([*code, *direction[row], *up[row], ratio[row], *harmonics[row]], np.float64))
    return -1 + 3 / (1 + np.exp(-naive_layers(weights.decoder, rows)))


def test_decoder_follows_the_definition(weights, pixels):
    part = tuple(array[:300] for array in pixels)
    wanted = naive_decode(weights, *part)
    np.testing.assert_allclose(np.stack(decode(weights, *part, clip=False), axis=1), wanted, atol=TOLERANCE)
    np.testing.assert_allclose(np.stack(decode(weights, *part), axis=1), np.clip(wanted, 0, 1), atol=TOLERANCE)


def test_decoder_with_torch(weights, pixels):
    torch = pytest.importorskip("torch")
    from patchnet.training.network.patchnet import PatchNet

    with torch.no_grad():
        outputs = PatchNet(weights).decode(*map(torch.from_numpy, pixels)).numpy()
    coverage, luminance = decode(weights, *pixels, clip=False)
    assert np.abs(outputs[:, 0] - coverage).max() <= TOLERANCE
    assert np.abs(outputs[:, 1] - luminance).max() <= TOLERANCE


@pytest.fixture(scope="module", params=[48, 78])
def mixture(request):
    return Weights.random(seed=6, bias=0.1, kind=MIXTURE.of_width(request.param))


@pytest.fixture(scope="module")
def mixed_pixels(pixels):
    """Inputs of a mixture for the same rays; some cells do not exist."""
    codes, direction, up, ratio = pixels
    random = np.random.default_rng(3)
    covered = random.uniform(0.01, 1, (COUNT, 64)) * (random.random((COUNT, 64)) < 0.6)
    others = random.normal(size=(COUNT, 8, 4)), random.random((COUNT, 9)), covered, random.random((COUNT, 65))
    corner_codes, view, covered, luminances = (array.astype(np.float32) for array in others)
    return MixtureInputs(codes, corner_codes, direction, up, ratio, view, covered, luminances)


def test_mixture_follows_the_definition(mixture, mixed_pixels):
    part = mixed_pixels.part(slice(0, 300))
    harmonics = real_harmonics(part.direction.astype(np.float64))
    rows = []
    for row in range(300):
        code = [part.codes[row, k] * harmonics[row, k] for k in range(9)] + [part.codes[row, 9]]
        ray = [*part.direction[row], *part.up[row], part.ratio[row], *harmonics[row]]
        place = [*part.corner_codes[row].ravel(), *part.view[row], *part.covered[row]]
        rows.append(np.array([*code, *ray, *place], np.float64))
    outputs = naive_layers(mixture.decoder, rows)
    shares = np.exp(outputs[:, 1:])
    shares[:, :64] *= part.covered
    wanted = (shares * part.luminances).sum(axis=1) / shares.sum(axis=1)
    coverage, luminance = decode_mixture(mixture, part)
    np.testing.assert_allclose(luminance, wanted, atol=TOLERANCE)
    np.testing.assert_allclose(coverage, np.clip(-1 + 3 / (1 + np.exp(-outputs[:, 0])), 0, 1), atol=TOLERANCE)
    brighter = replace(part, luminances=0.5 * part.luminances + np.float32(0.25))
    np.testing.assert_allclose(decode_mixture(mixture, brighter)[1], 0.5 * luminance + 0.25, atol=1e-6)


def test_mixture_with_torch(mixture, mixed_pixels):
    torch = pytest.importorskip("torch")
    from patchnet.training.data.tensor_batch import TensorNearby
    from patchnet.training.network.patchnet import PatchNet

    given = {name: torch.from_numpy(array) for name, array in vars(mixed_pixels).items()}
    near = TensorNearby(*(given.pop(name) for name in ("view", "covered", "luminances")))
    with torch.no_grad():
        outputs = PatchNet(mixture).decode_mixture(near=near, **given).numpy()
    coverage, luminance = decode_mixture(mixture, mixed_pixels)
    np.testing.assert_allclose(outputs[:, 0].clip(0, 1), coverage, atol=TOLERANCE)
    np.testing.assert_allclose(outputs[:, 1], luminance, atol=TOLERANCE)


def test_decoder_takes_nothing(weights):
    nothing = np.zeros((0, 3), np.float32)
    coverage, luminance = decode(weights, np.zeros((0, 10), np.float32), nothing, nothing, np.zeros(0, np.float32))
    assert coverage.shape == luminance.shape == (0,)


def test_decoder_saturates_without_overflow(weights, pixels):
    codes, *rest = (array[:10] for array in pixels)
    with np.errstate(all="raise"):
        coverage, _ = decode(weights, codes * 1e4, *rest)
    assert np.isin(coverage, (0, 1)).all()


def test_weights_survive_torch(weights):
    pytest.importorskip("torch")
    from patchnet.training.network.patchnet import PatchNet

    assert PatchNet(weights).to_weights().hash == weights.hash


def test_weights_file(weights, tmp_path):
    path = tmp_path / "w.safetensors"
    save_weights(Weights(weights.encoder, weights.decoder, {"data": "test"}), path)
    loaded = load_weights(path)
    assert loaded.hash == weights.hash
    assert loaded.metadata == {"data": "test"}
    assert Weights.random(1).hash != Weights.random(2).hash


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda arrays: arrays.pop("decoder.2.bias"), r"another network: it lacks 'decoder\.2\.bias'"),
        (lambda arrays: arrays.update({"encoder.0.weight": np.zeros((256, 320), np.float32)}), "shape"),
        (lambda arrays: arrays.update({"encoder.1.bias": np.full(256, np.nan, np.float32)}), "not finite"),
        (lambda arrays: arrays.update({"encoder.1.bias": np.zeros(256)}), "float64"),
    ],
)
def test_unusable_weights(weights, tmp_path, change, sentence):
    path = tmp_path / "bad.safetensors"
    arrays = weights.arrays()
    change(arrays)
    write_arrays(path, arrays, {"network": network(2)}, "weights")
    with pytest.raises(WeightsFileError, match=rf"bad\.safetensors.*{sentence}"):
        load_weights(path)


def test_file_says_the_kind_of_network(mixture, tmp_path):
    path = tmp_path / "mixture.safetensors"
    save_weights(mixture, path)
    loaded = load_weights(path)
    assert loaded.kind == mixture.kind and loaded.kind.name == MIXTURE.name and loaded.hash == mixture.hash
    write_arrays(path, mixture.arrays(), {"network": network(2, MIXTURE) | {"kind": "oracle"}}, "weights")
    with pytest.raises(WeightsFileError, match="its 'kind' is 'oracle' where this one has one of paper, mixture"):
        load_weights(path)
    write_arrays(path, mixture.arrays(), {"network": network(2)}, "weights")
    with pytest.raises(WeightsFileError, match="shape"):
        load_weights(path)
    odd = Weights.random(kind=MIXTURE.of_width(50)).arrays()
    write_arrays(path, odd, {"network": network(2, MIXTURE)}, "weights")
    with pytest.raises(WeightsFileError, match=r"shape \(50,\) where decoders have a multiple of 6 numbers, 6 to 78"):
        load_weights(path)


@pytest.mark.parametrize("stated", [{}, {**network(2), "look_ahead": 3}])
def test_weights_of_another_network(weights, tmp_path, stated):
    path = tmp_path / "other.safetensors"
    write_arrays(path, weights.arrays(), {"network": stated}, "weights")
    with pytest.raises(WeightsFileError, match=r"other\.safetensors belongs to another network: its 'patch'"):
        load_weights(path)


@pytest.fixture(scope="module")
def corners():
    """Blocks (U, 320), the first one empty, and rows (C, 8) of the eight blocks around each corner."""
    random = np.random.default_rng(7)
    occupied = random.random((60, 64, 1)) < 0.3
    blocks = np.where(occupied, random.uniform(-1, 1, (60, 64, 5)), 0).reshape(60, 320).astype(np.float32)
    blocks[0] = 0
    return blocks, np.where(random.random((90, 8)) < 0.5, random.integers(1, 60, (90, 8)), 0)


def patches_of(blocks, rows):
    """(C, 8, 8, 8, 5), put together cell by cell."""
    patches = np.zeros((len(rows), 8, 8, 8, 5), np.float32)
    for corner, eight in enumerate(rows):
        for octant, row in enumerate(eight):
            x, y, z = 4 * (octant & 1), 4 * (octant >> 1 & 1), 4 * (octant >> 2)
            patches[corner, z : z + 4, y : y + 4, x : x + 4] = blocks[row].reshape(4, 4, 4, 5)
    return patches.reshape(len(rows), 2560)


def test_encoder_follows_the_definition(weights, corners):
    wanted = naive_layers(weights.encoder, patches_of(*corners).astype(np.float64))
    assert np.abs(NumpyEncoder(weights)(*corners) - wanted).max() <= TOLERANCE


def test_encoder_with_torch(weights, corners):
    torch = pytest.importorskip("torch")
    from patchnet.patchnet_addon.network.torch_encode import TorchEncoder
    from patchnet.training.network.patchnet import PatchNet

    codes = NumpyEncoder(weights)(*corners)
    assert np.abs(TorchEncoder(weights)(*corners) - codes).max() <= TOLERANCE
    with torch.no_grad():
        module = PatchNet(weights).encode(torch.from_numpy(corners[0][corners[1]])).numpy()
    assert np.abs(module - codes).max() <= TOLERANCE


def test_whole_network_with_torch(weights, corners, pixels):
    torch = pytest.importorskip("torch")
    from patchnet.training.network.patchnet import PatchNet, interpolate

    count = 11
    blocks, rows = corners
    random = np.random.default_rng(4)
    entry = random.uniform(size=(count, 3)).astype(np.float32)
    eight = random.integers(0, len(rows), (count, 8))
    _, direction, up, ratio = (array[:count] for array in pixels)
    naive_codes = naive_layers(weights.encoder, patches_of(blocks, rows).astype(np.float64))
    mixed = np.zeros((count, 10))
    for pixel, (x, y, z) in enumerate(entry.astype(np.float64)):
        for octant in range(8):
            share = (x, 1 - x)[not octant & 1] * (y, 1 - y)[not octant & 2] * (z, 1 - z)[not octant & 4]
            mixed[pixel] += share * naive_codes[eight[pixel, octant]]
    model = PatchNet(weights)
    with torch.no_grad():
        codes = model.encode(torch.from_numpy(blocks[rows[eight]]).flatten(0, 1)).view(count, 8, -1)
        codes = interpolate(codes, torch.from_numpy(entry[:, None]))[:, 0]
        outputs = model.decode(codes, *map(torch.from_numpy, (direction, up, ratio)))
    assert np.abs(outputs.numpy() - naive_decode(weights, mixed, direction, up, ratio)).max() <= TOLERANCE
