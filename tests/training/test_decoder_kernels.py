# SPDX-License-Identifier: GPL-3.0-or-later
"""Kernels between the decoder's layers in training: results and gradients as torch's, step by step."""

from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip("torch")
from patchnet.patchnet_addon.network.kinds import KINDS, PAPER, NetworkKind  # noqa: E402
from patchnet.patchnet_addon.network.weights import Weights  # noqa: E402
from patchnet.patchnet_addon.runtime.progress import drain  # noqa: E402
from patchnet.tests.training.procedural import spheres_and_slats  # noqa: E402
from patchnet.training.data.batches import Augmentation  # noqa: E402
from patchnet.training.data.corpus import Corpus, corpus_of  # noqa: E402
from patchnet.training.data.dataset import Dataset  # noqa: E402
from patchnet.training.data.samples import SampleSettings, draw_samples  # noqa: E402
from patchnet.training.data.tensor_batch import TensorBatch  # noqa: E402
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


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_kernels_equal_torch(dataset: Dataset, kind: NetworkKind) -> None:
    rows = np.arange(VOXELS)
    augmentation = Augmentation.random(VOXELS, np.random.default_rng(1))
    batch = TensorBatch.of(corpus(dataset, kind).batch(rows, augmentation))
    model = SlicedNet(Weights.random(3, bias=0.1, kind=kind))
    torch.manual_seed(3)
    eight = (2 * torch.randn(VOXELS, 8, 10)).requires_grad_()
    wanted = [eight, *model.net.decoder.parameters()]
    weights = torch.randn(4 * VOXELS, 2)
    values, gradients = [], []
    for decoded in (model._decoded_on_cpu, model._decoded):
        values.append(decoded(eight, batch))
        gradients.append(torch.autograd.grad((values[-1] * weights).sum(), wanted))
    torch.testing.assert_close(values[0], values[1], atol=2e-6, rtol=0)
    for ours, theirs in zip(*gradients, strict=True):
        torch.testing.assert_close(ours, theirs, atol=1e-5 * theirs.abs().max().item(), rtol=1e-4)


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
