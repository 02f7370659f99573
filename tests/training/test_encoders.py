# SPDX-License-Identifier: GPL-3.0-or-later
"""Convolving encoders: torch against NumPy, files, devices."""

import importlib.util

import numpy as np
import pytest

from patchnet.patchnet_addon.codes.encode import encode_octree
from patchnet.patchnet_addon.network import weights as engine_weights
from patchnet.patchnet_addon.network.encoders import MLP
from patchnet.patchnet_addon.network.kinds import MIXTURE, PAPER
from patchnet.patchnet_addon.network.weights import Weights, network, save_weights
from patchnet.patchnet_addon.runtime.errors import SettingError, WeightsFileError
from patchnet.patchnet_addon.runtime.files import write_arrays
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.tests.engine.octree_samples import random_octree
from patchnet.tests.training.convolution_reference import NumpyConvolutions
from patchnet.training.encoders import CONV3D, VOXCEPTION, load_weights
from patchnet.training.network import research_encoder as research
from patchnet.training.network.research_encoder import research_encoder

CONVOLVING = (CONV3D, VOXCEPTION)
TOLERANCE = 2e-5  # float32 sums of up to 1,500 products of about 1, in another order
needs_torch = pytest.mark.skipif(importlib.util.find_spec("torch") is None, reason="torch is not installed")


def corners(lookahead, count=7, seed=3):
    """Blocks (U, B), the first one empty, and rows (C, 8) of the eight blocks around each corner."""
    random, cells = np.random.default_rng(seed), 8**lookahead
    occupied = random.random((12, cells, 1)) < 0.3
    blocks = np.where(occupied, random.uniform(-1, 1, (12, cells, 5)), 0).reshape(12, -1).astype(np.float32)
    blocks[0] = 0
    return blocks, random.integers(0, 12, (count, 8))


@needs_torch
@pytest.mark.parametrize(("lookahead", "count"), [(1, 0), (1, 5), (2, 1), (2, 7), (3, 2)])
@pytest.mark.parametrize("kind", CONVOLVING, ids=lambda kind: kind.name)
def test_torch_with_numpy(kind, lookahead, count):
    import torch

    from patchnet.training.network.patchnet import PatchNet

    weights = Weights.random(5, bias=0.1, lookahead=lookahead, encoder=kind)
    blocks, rows = corners(lookahead, count)
    wanted = NumpyConvolutions(weights)(blocks, rows)
    assert wanted.shape == (count, 10) and wanted.dtype == np.float32
    np.testing.assert_allclose(research_encoder(weights)(blocks, rows), wanted, atol=TOLERANCE)
    model = PatchNet(weights)
    assert model.to_weights().hash == weights.hash
    with torch.no_grad():
        np.testing.assert_allclose(model.encode(torch.from_numpy(blocks[rows])).numpy(), wanted, atol=TOLERANCE)


@pytest.mark.parametrize("kind", CONVOLVING, ids=lambda kind: kind.name)
def test_file_says_the_encoder(kind, tmp_path):
    path, weights = tmp_path / "w.safetensors", Weights.random(3, lookahead=1, kind=MIXTURE, encoder=kind)
    save_weights(weights, path)
    loaded = load_weights(path)
    assert loaded.encoder_kind is kind and loaded.kind is MIXTURE and loaded.hash == weights.hash
    own = network(1, MIXTURE, kind)
    for stated, sentence in (
        (own | {"encoder": "unet"}, "its 'encoder' is 'unet' where this one has one of mlp, conv3d, vox"),
        (own | {"encoder_layers": "of somebody else"}, "its 'encoder_layers' is 'of somebody else'"),
        (network(1, MIXTURE, MLP), "shape"),
    ):
        write_arrays(path, weights.arrays(), {"network": stated}, "weights")
        with pytest.raises(WeightsFileError, match=sentence):
            load_weights(path)


@pytest.mark.parametrize("width", [64, 320])
def test_file_has_linear_layers_of_any_width(width, tmp_path):
    path, weights = tmp_path / "w.safetensors", Weights.random(3, kind=MIXTURE, encoder=MLP.of_width(width))
    save_weights(weights, path)
    loaded = load_weights(path)
    assert loaded.encoder_kind == MLP.of_width(width) and loaded.lookahead == 2 and loaded.hash == weights.hash
    arrays = weights.arrays() | {"encoder.0.bias": np.zeros(width + 1, np.float32)}
    write_arrays(path, arrays, {"network": network(2, MIXTURE)}, "weights")
    with pytest.raises(WeightsFileError, match=f"shape .{width + 1},. where encoders have a multiple of 64 numbers"):
        load_weights(path)


def test_the_engine_refuses_what_it_does_not_run(tmp_path):
    save_weights(Weights.random(3, lookahead=1, encoder=CONV3D), tmp_path / "w.safetensors")
    with pytest.raises(WeightsFileError, match="the encoder 'conv3d', which research commands alone run: choose"):
        engine_weights.load_weights(tmp_path / "w.safetensors")


def test_what_needs_torch_says_so(monkeypatch):
    assert research_encoder(Weights.random(3)) is None
    monkeypatch.setattr(research, "has_torch", lambda: False)
    with pytest.raises(SettingError, match=r"encoder 'conv3d' .* install it"):
        research_encoder(Weights.random(3, lookahead=1, encoder=CONV3D))


@needs_torch
@pytest.mark.parametrize("network_kind", [PAPER, MIXTURE], ids=lambda kind: kind.name)
@pytest.mark.parametrize("kind", CONVOLVING, ids=lambda kind: kind.name)
def test_codes_of_an_octree(kind, network_kind):
    octree, weights = random_octree(2, depth=5), Weights.random(6, 0.1, 1, network_kind, kind)
    wanted = drain(encode_octree(octree, weights, encoder=NumpyConvolutions(weights))).codes
    found = drain(encode_octree(octree, weights, encoder=research_encoder(weights))).codes
    np.testing.assert_allclose(found, wanted, atol=2e-3, rtol=1e-3)  # half floats
