# SPDX-License-Identifier: GPL-3.0-or-later
"""Weights files; the mixture network in torch and NumPy; spherical harmonics against scipy's."""

import numpy as np
import pytest
from scipy.special import sph_harm_y

from patchnet.patchnet_addon.network.harmonics import real_harmonics
from patchnet.patchnet_addon.network.kinds import MIXTURE
from patchnet.patchnet_addon.network.weights import Weights, load_weights, network, save_weights
from patchnet.patchnet_addon.runtime.errors import WeightsFileError
from patchnet.patchnet_addon.runtime.files import write_arrays
from patchnet.tests.references.networks import MixtureInputs, decode_mixture

COUNT = 1000
WEIGHTS = Weights.random(seed=5, bias=0.1)
PLAIN = WEIGHTS.arrays()


@pytest.fixture(scope="module", params=[48, 78])
def mixture(request):
    return Weights.random(seed=6, bias=0.1, kind=MIXTURE.of_width(request.param))


def mixed_pixels():
    """Inputs of a mixture as rays bring them; some cells do not exist."""
    random = np.random.default_rng(2)
    direction = random.normal(size=(COUNT, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    up = np.cross(direction, random.normal(size=(COUNT, 3)))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    rays = random.normal(size=(COUNT, 10)) * 2, random.normal(size=(COUNT, 8, 4)), direction, up
    covered = random.uniform(0.01, 1, (COUNT, 64)) * (random.random((COUNT, 64)) < 0.6)
    others = random.uniform(0.5, 1, COUNT), random.random((COUNT, 9)), covered, random.random((COUNT, 65))
    return MixtureInputs(*(array.astype(np.float32) for array in (*rays, *others)))


def test_mixture_with_torch(mixture):
    torch = pytest.importorskip("torch")
    from patchnet.training.data.nearby import Nearby
    from patchnet.training.network.patchnet import PatchNet

    pixels = mixed_pixels()
    given = {name: torch.from_numpy(array) for name, array in vars(pixels).items()}
    near = Nearby(*(given.pop(name) for name in ("view", "covered", "luminances")))
    with torch.no_grad():
        outputs = PatchNet(mixture).decode_mixture(near=near, **given).numpy()
    coverage, luminance = decode_mixture(mixture, pixels)
    np.testing.assert_allclose(outputs[:, 0].clip(0, 1), coverage, atol=1e-4)
    np.testing.assert_allclose(outputs[:, 1], luminance, atol=1e-4)


def test_weights_file(tmp_path):
    path = tmp_path / "w.safetensors"
    save_weights(Weights(WEIGHTS.encoder, WEIGHTS.decoder, {"data": "test"}), path)
    loaded = load_weights(path)
    assert loaded.hash == WEIGHTS.hash
    assert loaded.metadata == {"data": "test"}
    assert Weights.random(1).hash != Weights.random(2).hash


@pytest.mark.parametrize(
    ("arrays", "stated", "sentence"),
    [
        (
            {name: array for name, array in PLAIN.items() if name != "decoder.2.bias"},
            network(2),
            r"belongs to another network: it lacks 'decoder\.2\.bias'",
        ),
        (PLAIN | {"encoder.0.weight": np.zeros((256, 320), np.float32)}, network(2), "shape"),
        (PLAIN | {"encoder.1.bias": np.full(256, np.nan, np.float32)}, network(2), "not finite"),
        (PLAIN | {"encoder.1.bias": np.zeros(256)}, network(2), "float64"),
        (PLAIN, {}, "belongs to another network: its 'patch'"),
        (PLAIN, network(2) | {"look_ahead": 3}, "belongs to another network: its 'patch'"),
        *((PLAIN, network(2) | {"look_ahead": other}, "its 'look_ahead' is .* one of 1, 2, 3") for other in (4, None)),
    ],
)
def test_unusable_weights(arrays, stated, sentence, tmp_path):
    assert_refused(arrays, stated, sentence, tmp_path)


def assert_refused(arrays, stated, sentence, tmp_path):
    """Weights of a network that a file describes otherwise."""
    write_arrays(tmp_path / "bad.safetensors", arrays, {"network": stated}, "weights")
    with pytest.raises(WeightsFileError, match=rf"bad\.safetensors.*{sentence}"):
        load_weights(tmp_path / "bad.safetensors")


def test_file_says_the_kind_of_network(mixture, tmp_path):
    path = tmp_path / "mixture.safetensors"
    save_weights(mixture, path)
    loaded = load_weights(path)
    assert loaded.kind == mixture.kind and loaded.kind.name == MIXTURE.name and loaded.hash == mixture.hash
    wrong = network(2, MIXTURE) | {"kind": "oracle"}
    sentence = "its 'kind' is 'oracle' where this one has one of paper, mixture"
    assert_refused(mixture.arrays(), wrong, sentence, tmp_path)
    assert_refused(mixture.arrays(), network(2), "shape", tmp_path)
    odd = Weights.random(kind=MIXTURE.of_width(50)).arrays()
    sentence = r"shape \(50,\) where decoders have a multiple of 6 numbers, 6 to 78"
    assert_refused(odd, network(2, MIXTURE), sentence, tmp_path)


def _real_from_complex(degree, order, polar, azimuth):
    value = np.sqrt(2) * (-1.0) ** order * sph_harm_y(degree, abs(order), polar, azimuth)
    return value.imag if order < 0 else value.real if order > 0 else value.real / np.sqrt(2)


def test_equal_to_scipy():
    directions = np.random.default_rng(1).normal(size=(200, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    polar, azimuth = np.arccos(directions[:, 2]), np.arctan2(directions[:, 1], directions[:, 0])
    values = real_harmonics(directions)
    for degree in range(5):
        for order in range(-degree, degree + 1):
            wanted = _real_from_complex(degree, order, polar, azimuth)
            np.testing.assert_allclose(values[:, degree**2 + degree + order], wanted, atol=1e-12)
