# SPDX-License-Identifier: GPL-3.0-or-later
"""Kernels of the decoder and the loss in training: results and gradients as torch's, step by step."""

from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip("torch")
from patchnet.patchnet_addon.network.compiled_layers import exponential  # noqa: E402
from patchnet.patchnet_addon.network.kinds import KINDS, MIXTURE, PAPER, NetworkKind  # noqa: E402
from patchnet.patchnet_addon.network.lanes import LANES, load  # noqa: E402
from patchnet.patchnet_addon.network.weights import Weights  # noqa: E402
from patchnet.patchnet_addon.runtime.kernels import kernel  # noqa: E402
from patchnet.patchnet_addon.runtime.progress import drain  # noqa: E402
from patchnet.patchnet_addon.runtime.vectors import store  # noqa: E402
from patchnet.tests.training.procedural import spheres_and_slats  # noqa: E402
from patchnet.training.data.batches import Augmentation  # noqa: E402
from patchnet.training.data.corpus import Corpus, corpus_of  # noqa: E402
from patchnet.training.data.dataset import Dataset  # noqa: E402
from patchnet.training.data.samples import SampleSettings, draw_samples  # noqa: E402
from patchnet.training.data.tensor_batch import TensorBatch, TensorNearby  # noqa: E402
from patchnet.training.network.decoder_products import add_products, apply_layer  # noqa: E402
from patchnet.training.network.lane_exponential import falling_exponential  # noqa: E402
from patchnet.training.network.losses import loss_gradient, loss_gradient_reference  # noqa: E402
from patchnet.training.network.sliced_net import SlicedNet  # noqa: E402

VOXELS = 30


@pytest.fixture(scope="module")
def dataset() -> Dataset:
    octree = spheres_and_slats(6, seed=5)
    samples = drain(draw_samples(octree, 4 * VOXELS, SampleSettings(views=4, min_level=3, held_out=0.0, seed=2)))
    return Dataset("scene", octree, samples, {})


def corpus(dataset: Dataset, kind: NetworkKind) -> Corpus:
    return corpus_of([dataset], nearby=kind.mixes)[0]


def assert_decoded_alike(kind: NetworkKind, batch: TensorBatch) -> None:
    """Results and all gradients as torch's; a ReLU near 0 may let through in one alone: none does by these seeds."""
    model = SlicedNet(Weights.random(3, bias=0.1, kind=kind))
    torch.manual_seed(3)
    eight = (2 * torch.randn(len(batch.ratio), 8, 10)).requires_grad_()
    wanted = [eight, *model.net.decoder.parameters()]
    weights = torch.randn(batch.ratio.numel(), 2)
    values, gradients = [], []
    for decoded in (model._decoded_on_cpu, model._decoded):
        values.append(decoded(eight, batch))
        gradients.append(torch.autograd.grad((values[-1] * weights).sum(), wanted))
    torch.testing.assert_close(values[0], values[1], atol=4e-6, rtol=0)
    for ours, theirs in zip(*gradients, strict=True):
        torch.testing.assert_close(ours, theirs, atol=1e-5 * np.abs(theirs.numpy()).max(initial=0), rtol=1e-4)


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_kernels_equal_torch(dataset: Dataset, kind: NetworkKind) -> None:
    augmentation = Augmentation.random(VOXELS, np.random.default_rng(1))
    assert_decoded_alike(kind, TensorBatch.of(corpus(dataset, kind).batch(np.arange(VOXELS), augmentation)))


def random_batch(kind: NetworkKind, voxels: int, views: int) -> TensorBatch:
    """What the decoder is given of a batch; the cells that cover nothing are many."""
    shape = voxels, views
    torch.manual_seed(4)
    direction, up = (torch.nn.functional.normalize(torch.randn(*shape, 3), dim=-1) for _ in range(2))
    near = None
    if kind.mixes:
        covered = (3 * torch.rand(*shape, 64) - 2).clamp(min=0)
        near = TensorNearby(torch.randn(*shape, 9), covered, torch.rand(*shape, 65))
    nothing = torch.empty(0)
    rays = torch.rand(*shape, 3), direction, up, torch.rand(shape)
    return TensorBatch(nothing, [0] * 9, nothing, nothing, *rays, nothing, nothing, nearby=near)


WIDTHS = [PAPER, MIXTURE, *(MIXTURE.of_width(width) for width in (6, 48, 66))]


@pytest.mark.parametrize("kind", WIDTHS, ids=lambda kind: f"{kind.name}-{kind.width}")
@pytest.mark.parametrize(("voxels", "views"), [(1, 1), (1, 8), (3, 8), (45, 3), (2, 150), (256, 8)])
def test_any_width_and_number_of_views(kind: NetworkKind, voxels: int, views: int) -> None:
    """Also those that are no multiple of a tile, of a vector or of a block of rows, and voxels in two tiles."""
    assert_decoded_alike(kind, random_batch(kind, voxels, views))


def test_decoder_of_no_views() -> None:
    assert_decoded_alike(PAPER, random_batch(PAPER, 0, 8))


@kernel
def multiply(values, depth, matrix, bias, least, result, sums):
    apply_layer(values, depth, matrix, bias, least, result)
    add_products(values, len(sums), result, np.full(1, -np.inf, np.float32), sums)


@pytest.mark.parametrize("vectors", range(1, 12))
def test_products_are_numpys(vectors: int) -> None:
    """Of all numbers of vectors in a row; the order of additions differs."""
    random = np.random.default_rng(6)
    width = LANES * vectors
    values, matrix = random.standard_normal((24, 40), np.float32), random.standard_normal((37, 192), np.float32)
    bias, sums = random.standard_normal(192, np.float32), random.standard_normal((16, 192), np.float32)
    before, result = sums.copy(), np.empty((24, width), np.float32)
    multiply(values, 37, matrix, bias, np.zeros(1, np.float32), result, sums)
    wanted = np.maximum(values[:, :37] @ matrix[:, :width] + bias[:width], 0)
    np.testing.assert_allclose(result, wanted, atol=1e-5)
    before[:, :width] += values[:, :16].T @ result
    np.testing.assert_allclose(sums, before, atol=1e-4)


@kernel
def exponentials(powers, found, wanted):
    for k in range(0, len(powers), LANES):
        store(found, k, falling_exponential(load(powers, k)))
    for k in range(len(powers)):
        wanted[k] = exponential(min(max(powers[k], np.float32(-80)), np.float32(0)))


def test_exponentials_of_vectors() -> None:
    """As those of numbers, which round one step more; what is out of bounds is taken to the next bound."""
    powers = np.linspace(-90, 1, 4096, dtype=np.float32)
    found, wanted = np.empty((2, 4096), np.float32)
    exponentials(powers, found, wanted)
    np.testing.assert_allclose(found, wanted, rtol=2e-7)
    np.testing.assert_allclose(found, np.exp(np.clip(powers.astype(np.float64), -80, 0)), rtol=2e-7)


@pytest.mark.parametrize("seen", ["some", "none"])
@pytest.mark.parametrize("squared", [True, False], ids=["squared", "absolute"])
def test_losses_equal_torch_and_what_they_say(dataset: Dataset, squared: bool, seen: str) -> None:
    """The kernel, its reference, and the gradient that torch finds for the loss written down as it is defined."""
    arrays = corpus(dataset, PAPER).batch(np.arange(VOXELS), Augmentation.none(VOXELS))
    batch = TensorBatch.of(arrays)
    batch.coverage[:2] = 0
    if seen == "none":
        batch.coverage[:] = 0
    torch.manual_seed(1)
    predicted = torch.rand(VOXELS, 4, 2, requires_grad=True)
    mask = (batch.coverage > 0).float()
    errors = predicted[..., 0] - batch.coverage, (predicted[..., 1] - batch.luminance) * mask
    first, second = (each.square().mean() if squared else each.abs().mean() for each in errors)
    wanted = torch.autograd.grad(first + 0.7 * second, [predicted])[0]
    sums = torch.stack([errors[0].abs().mean(), errors[1].abs().mean(), mask.mean()])
    for measure in (loss_gradient, loss_gradient_reference):
        gradient, found = measure(predicted, batch, squared=squared, luminance_weight=0.7)
        torch.testing.assert_close(gradient, wanted, atol=1e-8, rtol=1e-5)
        torch.testing.assert_close(found, sums, atol=1e-7, rtol=1e-5)


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_only_a_mixture_is_blind_to_luminance(dataset: Dataset, kind: NetworkKind) -> None:
    def blocks(nearby: bool) -> np.ndarray:
        which = replace(corpus(dataset, kind), nearby=nearby)
        return which.batch(np.arange(VOXELS), Augmentation.none(VOXELS)).blocks

    whole = blocks(nearby=False).reshape(-1, 5)
    assert whole[:, 1].any()
    seen = np.delete(whole, 1, axis=1) if kind.mixes else whole
    np.testing.assert_array_equal(blocks(nearby=kind.mixes).reshape(seen.shape), seen)
