# SPDX-License-Identifier: GPL-3.0-or-later
"""Adam's step with clipped gradients, and the moving mean of the parameters, by torch in few launches of a GPU.

The same as `torch.nn.utils.clip_grad_norm_`, `torch.optim.Adam` and `torch.lerp` after each other, and on that
optimiser's own state, as `CpuAdam`.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from .cpu_adam import KEPT, LEAST_NORM, state_of
from .replayed import Replayed


class GpuAdam:
    """Optimiser that takes the steps of `optimizer`, and moves the means of its parameters after each.

    means: of the parameters in their order. clip: greatest norm of all gradients, 0 for none. The optimiser has one
    group with a rate, betas and epsilon, and nothing else. Goes on from the state that it has.
    """

    def __init__(self, optimizer: torch.optim.Adam, means: Sequence[Tensor], clip: float) -> None:
        (self._group,) = optimizer.param_groups
        assert not any(self._group[name] for name in ("weight_decay", "amsgrad", "maximize"))
        self._parameters: list[Tensor] = self._group["params"]
        self._states = [state_of(optimizer, parameter) for parameter in self._parameters]
        self._steps = int(self._states[0]["step"])
        self._moments, self._squares = ([state[name] for state in self._states] for name in KEPT)
        self._means, self._clip = list(means), clip
        device = self._parameters[0].device
        sizes = [parameter.numel() for parameter in self._parameters]
        self._gradient = torch.empty(sum(sizes), device=device)
        parts = zip(self._gradient.split(sizes), self._parameters, strict=True)
        self._gradients = [part.view_as(parameter) for part, parameter in parts]
        self._numbers = torch.zeros(3, device=device)  # that are others at each step
        self._replayed = Replayed(self._step, device)

    @torch.no_grad()
    def step(self, gradient: Tensor, *, share: float) -> None:
        """Take a step along the gradient (n,) of all; means become (1 - share) mean + share parameter."""
        self._steps += 1
        first, second = self._group["betas"]
        length = self._group["lr"] / (1 - first**self._steps)  # both moments began at 0
        root = (1 - second**self._steps) ** -0.5
        self._numbers.copy_(torch.tensor([length, root, share]))
        self._gradient.copy_(gradient)
        self._replayed()

    def _step(self) -> None:
        """What a step does, by tensors alone."""
        first, second = self._group["betas"]
        length, root, share = self._numbers.unbind()
        gradients = self._gradients
        if self._clip:
            norm = torch.linalg.vector_norm(torch.stack(torch._foreach_norm(gradients)))
            scale = (self._clip / (norm + LEAST_NORM)).clamp(max=1.0)
            gradients = list(torch._foreach_mul(gradients, scale))
        torch._foreach_lerp_(self._moments, gradients, 1 - first)
        torch._foreach_mul_(self._squares, second)
        torch._foreach_addcmul_(self._squares, gradients, gradients, 1 - second)
        below = torch._foreach_sqrt(self._squares)
        torch._foreach_mul_(below, root)
        torch._foreach_add_(below, self._group["eps"])
        steps = torch._foreach_div(self._moments, below)
        torch._foreach_mul_(steps, length)
        torch._foreach_sub_(self._parameters, steps)
        moves = torch._foreach_sub(self._parameters, self._means)
        torch._foreach_mul_(moves, share)
        torch._foreach_add_(self._means, moves)

    def store(self) -> None:
        """Write the number of steps into the state of the optimiser, which has all else."""
        for state in self._states:
            state["step"].fill_(self._steps)
