# SPDX-License-Identifier: GPL-3.0-or-later
"""The network with torch and in plain NumPy: one result; and files of weights."""

import numpy as np
import pytest

from patchnet.patchnet_addon.network.encoders import MLP
from patchnet.patchnet_addon.network.kinds import MIXTURE
from patchnet.patchnet_addon.network.weights import Weights, load_weights, network, save_weights
from patchnet.patchnet_addon.runtime.errors import WeightsFileError
from patchnet.patchnet_addon.runtime.files import write_arrays
from patchnet.tests.references.networks import MixtureInputs, NumpyEncoder, decode, decode_mixture

COUNT = 1000
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


@pytest.mark.parametrize("width", [256, 64])
def test_encoder_with_torch(corners, width):
    torch = pytest.importorskip("torch")
    from patchnet.patchnet_addon.network.torch_encode import TorchEncoder
    from patchnet.training.network.patchnet import PatchNet

    weights = Weights.random(seed=5, bias=0.1, encoder=MLP.of_width(width))
    codes = NumpyEncoder(weights)(*corners)
    assert np.abs(TorchEncoder(weights)(*corners) - codes).max() <= TOLERANCE
    with torch.no_grad():
        module = PatchNet(weights).encode(torch.from_numpy(corners[0][corners[1]])).numpy()
    assert np.abs(module - codes).max() <= TOLERANCE


def test_interpolation_with_torch():
    torch = pytest.importorskip("torch")
    from patchnet.training.network.patchnet import interpolate

    random = np.random.default_rng(4)
    codes, entry = random.normal(size=(11, 8, 10)), random.uniform(size=(11, 3))
    mixed = np.zeros((11, 10))
    for pixel, (x, y, z) in enumerate(entry):
        for octant in range(8):
            share = (x, 1 - x)[not octant & 1] * (y, 1 - y)[not octant & 2] * (z, 1 - z)[not octant & 4]
            mixed[pixel] += share * codes[pixel, octant]
    found = interpolate(*(torch.from_numpy(array.astype(np.float32)) for array in (codes, entry[:, None])))
    np.testing.assert_allclose(found[:, 0].numpy(), mixed, atol=TOLERANCE)
