# SPDX-License-Identifier: GPL-3.0-or-later
"""Layers on the CPU, forward and backward, by the kernels as by torch; sums of bfloat16 products in float32."""

import itertools

import numpy as np
import pytest

torch = pytest.importorskip("torch")
from torch import Tensor  # noqa: E402
from torch.nn import functional  # noqa: E402

from patchnet.training.network.corner_layer import SLICES, BlockPairs, corner_sums  # noqa: E402
from patchnet.training.network.cpu_encoder import CpuEncoder  # noqa: E402
from patchnet.training.network.cpu_layers import (  # noqa: E402
    add_bias,
    add_pairs,
    add_pairs_reference,
    gather_rows,
    gather_rows_reference,
    mask_gradient,
)

BOTH = pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
SMALL = 1 / 256  # beside 1 the next bfloat16 is 1 + 1 / 128: this much is rounded away


def pairs_of_all(corners: int, random: np.random.Generator, share: float = 0.7) -> tuple[list[int], Tensor, Tensor]:
    """Starts of slices, and blocks and corners of pairs: each corner meets each slice with a chance."""
    found = [np.flatnonzero(random.random(corners) < share) for _ in range(SLICES)]
    starts = np.concatenate([[0], np.cumsum([len(part) for part in found])]).tolist()
    corner = torch.from_numpy(np.concatenate(found))
    return starts, corner.clone(), corner


def small_terms() -> tuple[Tensor, list[int], Tensor]:
    """Products of one corner whose first is 1 and whose other seven are too small for bfloat16 to add to it."""
    products = torch.full((SLICES, 1, 4), SMALL, dtype=torch.bfloat16)
    products[0] = 1
    return products, list(range(SLICES + 1)), torch.zeros(SLICES, dtype=torch.int64)


@pytest.mark.parametrize("add", [add_pairs, add_pairs_reference])
def test_small_terms_count(add) -> None:
    products, starts, corner = small_terms()
    found = add(products, starts, corner, torch.zeros(4), 1)
    wanted = torch.tensor(1 + (SLICES - 1) * SMALL).bfloat16()
    assert wanted > 1 and (found == wanted).all()
    in_bfloat16 = torch.zeros(1, 4, dtype=torch.bfloat16)
    for product in products:
        in_bfloat16 += product[0]
    assert (in_bfloat16 == 1).all()  # what the test is about


def test_small_terms_count_by_torch() -> None:
    blocks = torch.ones(1, 5, dtype=torch.bfloat16)
    slices = torch.full((SLICES, 5, 4), SMALL / 5)
    slices[0] = 0.2
    only = torch.zeros(SLICES, 1, dtype=torch.int64)
    found = corner_sums(slices, blocks, only, only, 1)
    assert found.dtype == torch.float32
    torch.testing.assert_close(found, torch.full((1, 4), 1 + 7 * SMALL), atol=2e-3, rtol=0)


def test_gradients_of_many_small_terms() -> None:
    """4,096 corners with the same small gradient: bfloat16 would stop adding at 256 times one of them."""
    corners = 4096
    starts = [0, *[corners] * SLICES]
    corner = torch.arange(corners)
    slices, bias = (torch.zeros(shape, requires_grad=True) for shape in ((SLICES, 5, 16), (16,)))
    with torch.no_grad():
        bias += 1
    blocks = torch.ones(corners, 5)
    hidden = CpuEncoder.apply(torch.bfloat16, BlockPairs(blocks, starts, corner, corner, corners), slices, bias)
    of_slices, of_bias = torch.autograd.grad(SMALL * hidden.sum(), [slices, bias])
    assert (of_bias == corners * SMALL).all() and (of_slices[0] == corners * SMALL).all()
    assert not of_slices[1:].any()


@BOTH
def test_kernels_equal_torch(dtype: torch.dtype) -> None:
    random = np.random.default_rng(3)
    torch.manual_seed(3)
    starts, _, corner = pairs_of_all(100, random)
    products, bias = torch.randn(SLICES, 100, 48).to(dtype), torch.randn(48)
    values = torch.randn(100, 48).to(dtype)
    rows = gather_rows(values, corner, starts, 100)
    assert rows.dtype == dtype and (rows == gather_rows_reference(values, corner, starts, 100)).all()
    assert not rows[:, max(np.diff(starts)) :].any() and (rows[0, : starts[1]] == values[corner[: starts[1]]]).all()
    torch.testing.assert_close(
        add_pairs(products, starts, corner, bias, 100),
        add_pairs_reference(products, starts, corner, bias, 100),
        atol=0 if dtype == torch.bfloat16 else 1e-6, rtol=torch.finfo(dtype).eps / 2,  # in another order
    )  # fmt: skip
    wanted = torch.relu(products[0].float() + bias).to(dtype)
    hidden = add_bias(products[0].clone(), bias)
    assert (hidden == wanted).all()


@pytest.mark.parametrize(
    ("dtype", "given"),
    [(torch.bfloat16, torch.float32), (torch.bfloat16, torch.bfloat16), (torch.float32, torch.float32)],
)
def test_masked_gradient(dtype: torch.dtype, given: torch.dtype) -> None:
    torch.manual_seed(3)
    hidden, gradient = torch.relu(torch.randn(100, 48)).to(dtype), torch.randn(100, 48).to(given)
    kept = torch.where(hidden > 0, gradient.to(dtype), 0)
    found, sums = mask_gradient(gradient, hidden)
    assert found.dtype == dtype and (found == kept).all()
    torch.testing.assert_close(sums, kept.float().sum(0), atol=1e-4, rtol=1e-5)


@pytest.mark.parametrize(("dtype", "forward", "backward"), [(torch.float32, 1e-5, 1e-4), (torch.bfloat16, 0.02, 0.12)])
def test_encoder_equals_its_layers(dtype: torch.dtype, forward: float, backward: float) -> None:
    """Forward and backward, against torch in float32, which bfloat16 is near to: ReLUs near 0 let through or not."""
    random = np.random.default_rng(5)
    torch.manual_seed(5)
    corners, size, out = 160, 40, 32
    starts, block, corner = pairs_of_all(corners, random)
    blocks = torch.randn(corners, size).bfloat16().float()
    shapes = (SLICES, size, out), (out,), (out, out), (out,), (out, out), (out,)
    parameters = [(0.1 * torch.randn(shape)).bfloat16().float().requires_grad_() for shape in shapes]
    slices, bias, *layers = parameters
    found = CpuEncoder.apply(dtype, BlockPairs(blocks, starts, block, corner, corners), *parameters)
    padded = torch.zeros(SLICES, corners, dtype=torch.int64), torch.full((SLICES, corners), corners)
    for number, (first, last) in enumerate(itertools.pairwise(starts)):
        for there, which in zip(padded, (block, corner), strict=True):
            there[number, : last - first] = which[first:last]
    hidden = torch.relu(corner_sums(slices, blocks, *padded, corners) + bias)
    for matrix, added in zip(layers[::2], layers[1::2], strict=True):
        hidden = torch.relu(functional.linear(hidden, matrix, added))
    torch.testing.assert_close(found, hidden, atol=forward * hidden.abs().max().item(), rtol=0)
    weights = torch.randn(hidden.shape)
    kept = weights.clone()
    for ours, theirs in zip(
        torch.autograd.grad(found, parameters, weights),
        torch.autograd.grad(hidden, parameters, weights),
        strict=True,
    ):
        assert ours.dtype == torch.float32
        assert ((ours - theirs).norm() / theirs.norm()).item() < backward
    assert (weights == kept).all(), "the gradient that was given is the caller's"
