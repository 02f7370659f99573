# SPDX-License-Identifier: GPL-3.0-or-later
"""The encoder in matrix units, forward and backward, as by torch with the same rounding, and what it is made of."""

import ctypes
import subprocess
import sys
from dataclasses import replace

import numba
import numpy as np
import pytest

torch = pytest.importorskip("torch")
from torch import Tensor  # noqa: E402

from patchnet.patchnet_addon.runtime.aligned_memory import aligned  # noqa: E402
from patchnet.patchnet_addon.runtime.vectors import LANES, load  # noqa: E402
from patchnet.tests.training.tiled import TiledEncoder  # noqa: E402  needs torch
from patchnet.training.benchmarks.training_rate import TrainBench, _made  # noqa: E402
from patchnet.training.data.batches import Augmentation  # noqa: E402
from patchnet.training.data.bfloat16 import (  # noqa: E402
    copy_bits,
    load_bfloat,
    narrow_bits,
    pair_bits,
    store_bfloat,
    store_pairs,
)
from patchnet.training.data.corpus import corpus_of  # noqa: E402
from patchnet.training.data.tensor_batch import TensorBatch  # noqa: E402
from patchnet.training.network import matrix_units  # noqa: E402
from patchnet.training.network.corner_layer import SLICES, BlockPairs  # noqa: E402
from patchnet.training.network.losses import loss_gradient_reference  # noqa: E402
from patchnet.training.network.matrix_units import (  # noqa: E402
    add_products,
    clear_sums,
    leave_units,
    load_sums,
    matrix_units_usable,
    store_sums,
    transpose_words,
    use_units,
)
from patchnet.training.network.sliced_net import _pairs  # noqa: E402
from patchnet.training.network.tiled_encoder import encode_reference  # noqa: E402
from patchnet.training.network.tiled_packing import PackedMatrices  # noqa: E402
from patchnet.training.run.learner import Learner  # noqa: E402
from patchnet.training.settings import BF16, FP32, IMPROVED, PAPER, SQUARED, TrainSettings  # noqa: E402

needs_units = pytest.mark.skipif(not matrix_units_usable(), reason="this processor has no matrix units")


def bits_of(values: Tensor) -> np.ndarray:
    return values.bfloat16().contiguous().view(torch.int16).numpy().view(np.uint16)


def batch_of(corners: int, size: int, share: float = 0.6) -> BlockPairs:
    """Blocks, mostly of zeros, which each several corners meet; the first corner meets none, nor does octant 3."""
    random = np.random.default_rng(corners)
    found = [np.flatnonzero(random.random(corners - 1) < share) + 1 for _ in range(SLICES)]
    found[3] = found[3][:0]
    starts = np.concatenate([[0], np.cumsum([len(part) for part in found])]).tolist()
    corner = torch.from_numpy(np.concatenate(found))
    blocks = torch.randn(corners // 2, size) * (torch.rand(corners // 2, size) < 0.3)
    block = torch.from_numpy(random.integers(0, corners // 2, len(corner)))
    return BlockPairs(blocks.bfloat16(), starts, block, corner, corners)


def parameters_of(size: int, out: int) -> list[Tensor]:
    shapes = (SLICES, size, out), (out,), (out, out), (out,), (out, out), (out,), (10, out), (10,)
    return [(torch.randn(shape) * (shape[-1] ** -0.5)).requires_grad_() for shape in shapes]


def distance(found: Tensor, wanted: Tensor) -> float:
    """Length of the difference, of what is wanted."""
    return ((found - wanted).norm() / wanted.norm().clamp(min=1e-9)).item()


@needs_units
@pytest.mark.parametrize(
    ("corners", "size", "out"), [(24, 32, 64), (40, 320, 128), (600, 256, 256), (1100, 64, 192), (544, 2048, 64)]
)
def test_encoder_equals_its_reference(corners: int, size: int, out: int) -> None:
    torch.manual_seed(corners)
    batch, parameters = batch_of(corners, size), parameters_of(size, out)
    codes, wanted = TiledEncoder.apply(batch, *parameters), encode_reference(batch, *parameters)
    assert codes.dtype == torch.float32 and distance(codes, wanted) < 1e-3
    given = torch.randn(codes.shape)
    kept = given.clone()
    for ours, theirs in zip(
        torch.autograd.grad(codes, parameters, given), torch.autograd.grad(wanted, parameters, given), strict=True
    ):
        assert ours.shape == theirs.shape and distance(ours, theirs) < 0.01  # a ReLU near 0 lets through or not
    assert (given == kept).all()


@needs_units
def test_codes_and_their_gradients_are_as_good_as_float32() -> None:
    """With middle layers that hand on one number alone, a power of two: nothing else rounds."""
    torch.manual_seed(1)
    size = out = 64
    batch = batch_of(96, size)
    parameters = parameters_of(size, out)
    with torch.no_grad():
        for each in parameters[:-2]:
            each.zero_()
        parameters[5][:] = 2.0 ** torch.arange(-8, 8).repeat(4)
    codes = TiledEncoder.apply(batch, *parameters)
    hidden, last, of_last = (part.detach().double() for part in (parameters[5], *parameters[-2:]))
    exact = (last @ hidden + of_last).expand(96, -1)
    assert distance(codes.double(), exact) < 3e-7
    given = torch.randn(codes.shape)
    of_last_matrix, of_bias = torch.autograd.grad(codes, [parameters[-2], parameters[5]], given)
    wanted = given.double().sum(0)[:, None] * hidden
    assert distance(of_last_matrix.double(), wanted) < 1e-6
    rounded = (given.double() @ last).float().bfloat16().double().sum(0)
    assert distance(of_bias.double(), rounded) < 5e-4  # products right to 16 bits: a few round otherwise


@needs_units
def test_gradients_of_many_small_terms() -> None:
    """4,096 corners with the same small gradient: bfloat16 would stop adding at 256 times one of them."""
    corners, size, out, small = 4096, 32, 64, 1 / 256
    parameters = [torch.zeros_like(each).requires_grad_() for each in parameters_of(size, out)]
    with torch.no_grad():
        parameters[1] += 1
        for matrix in parameters[2], parameters[4]:
            matrix += torch.eye(out)
        parameters[6][0] = 1
    corner = torch.arange(corners)
    batch = BlockPairs(torch.ones(corners, size).bfloat16(), [0, *[corners] * SLICES], corner, corner, corners)
    codes = TiledEncoder.apply(batch, *parameters)
    of_slices, of_bias, *_ = torch.autograd.grad(small * codes[:, 0].sum(), parameters)
    assert (of_bias == corners * small).all() and (of_slices[0] == corners * small).all()
    assert not of_slices[1:].any()


@needs_units
@pytest.mark.parametrize("settings", [IMPROVED, PAPER], ids=["mixture", "paper"])
def test_gradients_of_a_batch(settings: TrainSettings) -> None:
    """By all parameters, and sums of errors: as by autograd through the reference, torch's decoder and loss."""
    corpus, _ = corpus_of([_made(TrainBench(nodes=20_000, samples=2_000))], nearby=settings.kind.mixes)
    learner = Learner(replace(settings, precision=BF16))
    batch = corpus.batch(np.arange(40), Augmentation.none(40), narrow=True)
    assert learner.multiplies_in_units(torch.bfloat16) and not learner.multiplies_in_units(torch.float32)
    ours, errors = learner.gradients(batch, torch.bfloat16, 0.5)

    model, tensors = learner.model, TensorBatch.of(batch)
    first, *others = model._encoder()
    layers = [part for layer in others for part in (layer.weight, layer.bias)]
    codes = encode_reference(_pairs(tensors), model.slices, first.bias, *layers)
    predicted = model._decoded(codes.view(40, 8, -1), tensors).view(40, -1, 2)
    loss = {"squared": settings.loss == SQUARED, "luminance_weight": settings.luminance_weight}
    gradient, wanted = loss_gradient_reference(predicted, tensors, **loss)
    theirs = torch.autograd.grad(predicted, model.trained(), 0.5 * gradient)
    torch.testing.assert_close(errors, 0.5 * wanted, atol=1e-4, rtol=1e-3)
    for one, other in zip(ours.split([each.numel() for each in theirs]), theirs, strict=True):
        assert distance(one, other.flatten()) < 0.01


@needs_units
def test_learner_in_float32_leaves_them_out() -> None:
    assert not Learner(replace(IMPROVED, precision=FP32)).multiplies_in_units(torch.bfloat16)


@needs_units
def test_packed_matrices_are_those_of_the_parameters() -> None:
    """After a step of the optimiser, and after torch wrote into them."""
    learner = Learner(replace(IMPROVED, precision=BF16))
    packed, sizes = learner._tiled.packed, learner._tiled.packed.sizes

    def assert_packed() -> None:
        parameters = [parameter.detach().clone() for parameter in learner.model.trained()]
        for ours, theirs in zip(packed.current(), PackedMatrices(parameters, sizes).current(), strict=True):
            assert (ours == theirs).all()

    assert_packed()
    before = packed.current().slices.copy()
    learner.step([torch.randn(sum(parameter.numel() for parameter in learner.model.trained()))], 0.1)
    assert (packed.arrays.slices != before).mean() > 0.9
    assert_packed()
    with torch.no_grad():
        learner.model.trained()[2].normal_()
    assert_packed()
    learner.load(Learner(replace(IMPROVED, precision=BF16, seed=5)).state())
    assert_packed()


def test_units_are_left_out_where_torch_leaves_them_out(monkeypatch) -> None:
    asked = matrix_units_usable.__wrapped__
    monkeypatch.setenv("ONEDNN_MAX_CPU_ISA", "AVX512_CORE_BF16")
    assert not asked()
    monkeypatch.delenv("ONEDNN_MAX_CPU_ISA")
    monkeypatch.setattr(sys, "platform", "win32")
    assert not asked()
    monkeypatch.undo()
    monkeypatch.setattr(matrix_units.binding, "get_host_cpu_features", lambda: {"avx512f": True})
    assert not asked()

    def unknown() -> None:
        raise RuntimeError

    monkeypatch.setattr(matrix_units.binding, "get_host_cpu_features", unknown)
    assert not asked()


def test_units_are_left_out_where_the_system_does_not_lend_them(monkeypatch) -> None:
    features = {"amx-tile": True, "amx-bf16": True, "avx512f": True}
    monkeypatch.delenv("ONEDNN_MAX_CPU_ISA", raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(matrix_units.binding, "get_host_cpu_features", lambda: features)
    for answer, usable in ((-1, False), (0, True)):
        library = type("Library", (), {"syscall": staticmethod(lambda *_, answer=answer: answer)})
        monkeypatch.setattr(ctypes, "CDLL", lambda _, library=library: library)
        assert matrix_units_usable.__wrapped__() == usable


@needs_units
def test_products_of_a_block() -> None:
    torch.manual_seed(2)
    left, right = torch.randn(32, 64).bfloat16(), torch.randn(64, 32).bfloat16()
    pairs = right.view(32, 2, 2, 16).permute(2, 0, 3, 1)  # tiles of 16 columns; rows by pairs
    sums = aligned((32, 32), np.float32)
    sums[:] = 1

    @numba.njit
    def multiply(left, right, sums):
        use_units()
        load_sums(sums, 0, 32)
        for k in range(0, 64, 32):
            add_products(left, k, 16 * 64 + k, 64, right, 16 * k, 32 * 32 + 16 * k)
        store_sums(sums, 0, 32)
        clear_sums()
        leave_units()

    multiply(bits_of(left), bits_of(pairs), sums)
    np.testing.assert_allclose(sums, 1 + (left.float() @ right.float()).numpy(), rtol=1e-5, atol=1e-4)


def test_words_change_rows_for_columns() -> None:
    @numba.njit
    def transpose(source, target):
        transpose_words(source, 20, 20, target, 3, 17)

    source = np.arange(17 * 20, dtype=np.uint32)
    target = np.zeros(3 + 16 * 17, np.uint32)
    transpose(source, target)
    assert (target[3:].reshape(16, 17)[:, :16] == source[20:].reshape(16, 20)[:, :16].T).all()
    assert not target[:3].any() and not target[3:].reshape(16, 17)[:, 16].any()


def test_vectors_of_bfloat16() -> None:
    values = np.concatenate([[0, -0.0, 1, 1 + 2**-8, 1 + 3 * 2**-8], np.random.default_rng(0).normal(0, 9, 27)])
    values = values.astype(np.float32)

    @numba.njit
    def convert(values, bits, back, pairs, copied, paired):
        for k in range(0, 32, LANES):
            store_bfloat(bits, k, load(values, k))
        for k in range(LANES):
            back[k] = narrow_bits(values[k])
        store_pairs(pairs, 0, load(values, 0), load(values, LANES))
        pair_bits(paired, 0, bits, 0, bits, LANES)
        copy_bits(copied, 0, bits, 0)

    bits, back, copied = (np.zeros(32, np.uint16) for _ in range(3))
    pairs, paired = (np.zeros(LANES, np.uint32) for _ in range(2))
    convert(values, bits, back, pairs, copied, paired)
    assert (bits == bits_of(torch.from_numpy(values))).all() and (bits[:LANES] == back[:LANES]).all()
    assert (copied == bits).all() and (pairs == paired).all()
    assert (pairs.view(np.uint16) == np.stack([bits[:LANES], bits[LANES:]], axis=-1).ravel()).all()

    @numba.njit
    def widen(bits, result):
        for k in range(0, 32, LANES):
            vector = load_bfloat(bits, k)
            store_bfloat(result, k, vector + vector)

    doubled = np.zeros(32, np.uint16)
    widen(bits, doubled)
    assert (doubled == bits_of(2 * torch.from_numpy(values).bfloat16().float())).all()


def test_aligned_memory() -> None:
    for shape, dtype in (((3, 5), np.uint16), ((7,), np.float32)):
        arrays = [aligned(shape, dtype) for _ in range(20)]
        assert all(array.ctypes.data % 64 == 0 and array.shape == shape and array.dtype == dtype for array in arrays)


def test_import_asks_nothing_of_the_system() -> None:
    """Only training itself asks Linux for matrix units: a process that imports the package stays as it was."""
    code = "import patchnet.training.run.trainer as _; from patchnet.training.network import matrix_units"
    code += "; assert matrix_units.matrix_units_usable.cache_info().currsize == 0"
    subprocess.run([sys.executable, "-c", code], check=True)
