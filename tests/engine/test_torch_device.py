# SPDX-License-Identifier: GPL-3.0-or-later
"""Encoding with torch on any device against the CPU, to a tolerance; names of devices.

Codes to 1e-4 and 1e-5 of the largest before they are rounded to half floats, coverage and luminance to 1e-3.
"""

import warnings

import numpy as np
import pytest

from patchnet.patchnet_addon.codes import encode
from patchnet.patchnet_addon.codes.brick import covering_nodes, voxel_blocks
from patchnet.patchnet_addon.codes.encode import encode_octree
from patchnet.patchnet_addon.network import devices
from patchnet.patchnet_addon.network.devices import enough_memory, found_device, read_device
from patchnet.patchnet_addon.network.weights import Weights, load_weights
from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.tests.engine.octree_samples import random_octree, with_boxes
from patchnet.tests.torch_devices import DEVICES, gpu_only

torch = pytest.importorskip("torch")
from patchnet.patchnet_addon.codes.torch_tree import (  # noqa: E402  needs torch
    TorchCorners,
    TorchTree,
    to_device,
)
from patchnet.patchnet_addon.network import torch_encode  # noqa: E402  needs torch

CODES, OUTPUTS = 1e-4, 1e-3
HALF = 2.0**-11  # relative rounding of a half float


@pytest.fixture(scope="module", params=[False, True], ids=["uniform", "adaptive, with boxes"])
def octree(request):
    octree = random_octree(seed=8, depth=6, count=1200, adaptive=request.param)
    return with_boxes(octree) if request.param else octree


def assert_same_codes(found, wanted):
    """Half floats of codes that agree as encoders do."""
    found, wanted = found.astype(np.float32), wanted.astype(np.float32)
    np.testing.assert_allclose(found, wanted, rtol=2 * HALF, atol=CODES + 1e-5 * np.abs(wanted).max())


def test_names_of_devices():
    assert [read_device(name) for name in ("auto", "cpu", "cuda", "cuda:0", " CUDA:12 ")] == [
        "auto", "cpu", "cuda", "cuda:0", "cuda:12"
    ]  # fmt: skip
    for name in ("", "gpu", "tpu", "cuda:", "cuda:x", "cuda:-1", "cpu:0", "cuda:99999"):
        with pytest.raises(SettingError, match=r"--device '.*' is unknown: choose auto, cpu, cuda, or cuda:N"):
            read_device(name, "--device")


def test_a_device_is_found_or_its_error_says_what_to_do(monkeypatch):
    assert found_device("cpu") == "cpu"
    monkeypatch.setattr(devices, "torch_has_gpu", lambda: False)
    assert found_device("auto") == "cpu"
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(SettingError, match=r"--device 'cuda' needs an NVIDIA GPU, and PyTorch .* finds none here: "):
        found_device("cuda", "--device")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    monkeypatch.setattr(torch.cuda, "current_device", lambda: 1)
    assert [found_device(name) for name in ("cuda", "cuda:0", "cuda:1")] == ["cuda:1", "cuda:0", "cuda:1"]
    with pytest.raises(SettingError, match=r"'cuda:2' does not exist: choose one .* \(cuda:0, cuda:1\), or cpu"):
        found_device("cuda:2")
    monkeypatch.setattr(devices, "torch_has_gpu", lambda: True)
    assert found_device("auto") == "cuda:1"
    monkeypatch.setattr(devices, "has_torch", lambda: False)
    with pytest.raises(SettingError, match="'cuda' needs PyTorch, which this Python does not have: install"):
        found_device("cuda")


def test_what_does_not_fit_is_said():
    with (
        pytest.raises(SettingError, match=r"too little free memory for encoding: free some"),
        enough_memory("encoding"),
    ):
        raise torch.OutOfMemoryError("CUDA out of memory")
    with pytest.raises(RuntimeError, match="else"), enough_memory("encoding"):
        raise RuntimeError("something else")


def test_copies_keep_their_bits():
    """Of read-only arrays too, which files of codes are."""
    random = np.random.default_rng(0)
    for kind in (np.uint8, np.int8, np.uint16, np.uint32, np.int64, np.float16, np.float32):
        array = random.integers(0, 120, (7, 3)).astype(kind)
        if kind in (np.uint16, np.uint32):
            array[0] = np.iinfo(kind).max
        array.setflags(write=False)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            found = to_device(array, torch.device("cpu"))
        np.testing.assert_array_equal(found.numpy().view(kind), array)
        assert to_device(array[:0], torch.device("cpu")).shape == (0, 3)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("lookahead", [1, 2, 3])
def test_blocks_on_a_device(octree, lookahead, device):
    """Bit for bit those of the kernels; cells outside the cube are empty."""
    tree = TorchTree(octree, torch.device(device))
    random = np.random.default_rng(0)
    for level in range(octree.depth + 1):
        cells = random.integers(-1, (1 << level) + 1, (500, 3))
        nodes = covering_nodes(octree, level, cells)
        np.testing.assert_array_equal(tree.covering(level, torch.from_numpy(cells).to(device)).cpu(), nodes)
        distinct = np.unique(nodes)
        fine = tree.fine_cells(torch.from_numpy(distinct).to(device), lookahead)
        blocks = voxel_blocks(octree, distinct, lookahead)
        np.testing.assert_array_equal(tree.values(fine).cpu().numpy().reshape(blocks.shape), blocks)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("lookahead", [1, 2, 3])
def test_codes_of_a_device(octree, lookahead, device, monkeypatch):
    """By blocks that are gathered there, and by blocks that the CPU gathers, in several chunks."""
    weights = Weights.random(4, bias=0.1, lookahead=lookahead)
    wanted = drain(encode_octree(octree, weights)).codes
    encoder = torch_encode.TorchEncoder(weights, device)
    encoder.chunk = 301
    monkeypatch.setattr(encode, "_corner_encoder", lambda *arguments: TorchCorners(*arguments))
    assert_same_codes(drain(encode_octree(octree, weights, encoder=encoder)).codes, wanted)
    monkeypatch.undo()
    assert_same_codes(drain(encode_octree(octree, weights, encoder=encoder)).codes, wanted)


@gpu_only
def test_tf32_of_the_process_changes_nothing(octree):
    """As NVIDIA's images switch it on for all; and it is on again afterwards."""
    weights = load_weights()
    wanted = drain(encode_octree(octree, weights)).codes
    matmul = torch.backends.cuda.matmul
    before = matmul.allow_tf32
    try:
        matmul.allow_tf32 = True
        assert_same_codes(drain(encode_octree(octree, weights, device="cuda")).codes, wanted)
        assert matmul.allow_tf32
    finally:
        matmul.allow_tf32 = before
