# SPDX-License-Identifier: GPL-3.0-or-later
"""Adam's step and the moving mean, of CPU and GPU: torch's own steps, and its own state, with which either goes on."""

import copy

import pytest

torch = pytest.importorskip("torch")
from patchnet.patchnet_addon.runtime.threads import limit_threads  # noqa: E402
from patchnet.tests.torch_devices import GPU  # noqa: E402  needs torch
from patchnet.training.network import cpu_adam  # noqa: E402  needs torch
from patchnet.training.network.cpu_adam import CpuAdam  # noqa: E402  needs torch
from patchnet.training.network.flat_memory import flat_gradient, flat_memory  # noqa: E402  needs torch
from patchnet.training.network.gpu_adam import GpuAdam  # noqa: E402  needs torch

SIZES = (3, 40), (77,), (2, 5, 31)


def _pair(device: str = "cpu"):
    """Parameters, their optimiser, and their means, twice the same."""
    torch.manual_seed(1)
    first = [torch.nn.Parameter(torch.randn(size).to(device)) for size in SIZES]
    both = []
    for parameters in (first, [torch.nn.Parameter(each.detach().clone()) for each in first]):
        optimizer = torch.optim.Adam(parameters, 1e-2, betas=(0.8, 0.95), eps=1e-6)
        both.append((parameters, optimizer, [torch.zeros(size, device=device) for size in SIZES]))
    return both


def _torch_step(parameters, optimizer, means, gradients, scale, share) -> None:
    for parameter, gradient in zip(parameters, gradients, strict=True):
        parameter.grad = scale * gradient
    optimizer.step()
    with torch.no_grad():
        for mean, parameter in zip(means, parameters, strict=True):
            mean.lerp_(parameter, share)


def _gradients(number: int):
    """Gradients of a step, of a middle size; one lies in memory in another order."""
    torch.manual_seed(number)
    found = [10.0 ** (number % 5 - 2) * torch.randn(size) for size in SIZES]
    found[0] = found[0].t().contiguous().t()
    return found


def _assert_same(first, second) -> None:
    for one, other in zip(first, second, strict=True):
        torch.testing.assert_close(one, other, atol=2e-6, rtol=2e-5)


KINDS = [(CpuAdam, 1, 1), (CpuAdam, 2, 2), (CpuAdam, 3, 2), (GpuAdam, 1, 1)]  # parts of a step, threads
RUNS = [(*kind, "cpu") for kind in KINDS] + [pytest.param(*KINDS[-1], "cuda", marks=GPU)]


def _take(ours, gradients, share: float, parts: int = 1) -> None:
    """Take a step of ours; on the CPU along the sum of so many parts."""
    flat = flat_gradient(gradients)
    if isinstance(ours, GpuAdam):
        ours.step(flat, share=share)
        return
    others = [torch.randn_like(flat) for _ in range(parts - 1)]
    ours.step([flat - sum(others), *others], share=share)


@pytest.mark.parametrize("clip", [0.0, 1.0])
@pytest.mark.parametrize(("kind", "parts", "threads", "device"), RUNS)
def test_steps_and_means_are_torchs(
    monkeypatch, kind: type, parts: int, threads: int, device: str, clip: float
) -> None:
    """Also of a state that was saved, as a checkpoint is; some gradients are shorter than they may be, some longer."""
    monkeypatch.setattr(cpu_adam, "_PIECE", 100)  # more pieces than parameters
    (wanted, peer, wanted_means), (found, optimizer, means) = _pair(device)
    ours = kind(optimizer, means, clip)
    for step in range(8):
        if step == 4:
            ours.store()
            state = copy.deepcopy(optimizer.state_dict())
            optimizer = torch.optim.Adam(found, 1e-2)
            optimizer.load_state_dict(state)
            ours = kind(optimizer, means, clip)
        for group in (*peer.param_groups, *optimizer.param_groups):
            group["lr"] = 0.02 / (1 + step)
        gradients = [gradient.to(device) for gradient in _gradients(step)]
        norm = torch.linalg.vector_norm(torch.cat([gradient.flatten() for gradient in gradients]))
        scale = min(1.0, clip / (float(norm) + 1e-6)) if clip else 1.0
        _torch_step(wanted, peer, wanted_means, gradients, scale, 0.5**step)
        with limit_threads(threads):
            _take(ours, gradients, 0.5**step, parts)
        _assert_same(found, wanted)
        _assert_same(means, wanted_means)
    moved = [(one - other).detach().abs().max() for one, other in zip(found, _pair(device)[0][0], strict=True)]
    assert max(moved) > 0.01


@pytest.mark.parametrize("torch_first", [True, False])
def test_a_run_goes_on_with_the_other(torch_first: bool) -> None:
    """Three steps by one, the state saved and loaded, three by the other: as six by torch."""
    (wanted, peer, wanted_means), (found, optimizer, means) = _pair()
    for step in range(6):
        _torch_step(wanted, peer, wanted_means, _gradients(step), 1.0, 0.25)
    ours = CpuAdam(optimizer, means)
    for step in range(3):
        if torch_first:
            _torch_step(found, optimizer, means, _gradients(step), 1.0, 0.25)
        else:
            ours.step([flat_gradient(_gradients(step))], share=0.25)
    if not torch_first:
        ours.store()
    after = torch.optim.Adam(found, 1e-2)
    after.load_state_dict(copy.deepcopy(optimizer.state_dict()))
    goes_on = CpuAdam(after, means)
    for step in range(3, 6):
        if torch_first:
            goes_on.step([flat_gradient(_gradients(step))], share=0.25)
        else:
            _torch_step(found, after, means, _gradients(step), 1.0, 0.25)
    _assert_same(found, wanted)
    _assert_same(means, wanted_means)


def test_flat_memory_is_that_of_the_tensors() -> None:
    tensors = [torch.randn(3, 4), torch.randn(5), torch.randn(2, 3).t()]
    wanted = [tensor.clone() for tensor in tensors]
    flat = flat_memory(tensors)
    assert flat_memory(tensors).data_ptr() == flat.data_ptr() and flat.shape == (23,)
    for tensor, like in zip(tensors, wanted, strict=True):
        assert torch.equal(tensor, like) and tensor.is_contiguous()
    flat += 1
    assert all(torch.equal(tensor, like + 1) for tensor, like in zip(tensors, wanted, strict=True))
    assert flat_memory(tensors[:2]).shape == (17,)
    apart = [tensors[1], tensors[0]]  # in another order they do not lie in a row
    moved = flat_memory(apart)
    assert moved.data_ptr() != flat.data_ptr() and torch.equal(moved[:5], wanted[1] + 1)
    turned = torch.arange(6.0).view(2, 3).t()
    assert flat_memory([turned]).tolist() == [0, 3, 1, 4, 2, 5] and turned.is_contiguous()
