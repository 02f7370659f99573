# SPDX-License-Identifier: GPL-3.0-or-later
"""Adam's step and the moving mean of the parameters in one pass over the memory, on the CPU.

The same as `torch.optim.Adam` and `torch.lerp` after it, and on that optimiser's own state, so that a run may go on
with either. Parameters and what is kept of them do not fit a core's cache: the time goes with the passes over them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ...patchnet_addon.runtime.kernels import kernel

KEPT = "exp_avg", "exp_avg_sq"  # torch's names of both moments


class CpuAdam:
    """Optimiser that takes the steps of `optimizer`, and moves the means of its parameters after each.

    means: of the parameters in their order. All lie on the CPU in float32, and the optimiser has one group with a
    rate, betas and epsilon, and nothing else. Goes on from the state that the optimiser has.
    """

    def __init__(self, optimizer: torch.optim.Adam, means: Sequence[Tensor]) -> None:
        (self._group,) = optimizer.param_groups
        assert not any(self._group[name] for name in ("weight_decay", "amsgrad", "maximize"))
        parameters: list[Tensor] = self._group["params"]
        self._states = [state_of(optimizer, parameter) for parameter in parameters]
        self._steps = int(self._states[0]["step"])
        moments, squares = ([state[name] for state in self._states] for name in KEPT)
        # Once: to find the memory of every tensor anew takes as long as a third of the step.
        self._memory = [
            [tensor.detach().view(-1).numpy() for tensor in each]  # refuses what would have to be copied
            for each in zip(parameters, moments, squares, means, strict=True)
        ]

    def step(self, gradients: Sequence[Tensor], *, scale: float, share: float) -> None:
        """Take a step along `scale` times the gradients; means become (1 - share) mean + share parameter.

        Runs on one thread.
        """
        self._steps += 1
        first, second = self._group["betas"]
        length = self._group["lr"] / (1 - first**self._steps)  # both moments began at 0
        root = (1 - second**self._steps) ** -0.5
        numbers = length, 1 - first, 1 - second, root, self._group["eps"], scale, share
        rates = np.array(numbers, np.float32)
        for gradient, memory in zip(gradients, self._memory, strict=True):
            _step(gradient.contiguous().view(-1).numpy(), rates, *memory)

    def store(self) -> None:
        """Write the number of steps into the state of the optimiser, which has all else."""
        for state in self._states:
            state["step"].fill_(self._steps)


def state_of(optimizer: torch.optim.Adam, parameter: Tensor) -> dict[str, Any]:
    """State of a parameter in an optimiser, as torch makes it before its first step."""
    state: dict[str, Any] = optimizer.state[parameter]
    if not state:
        state["step"] = torch.tensor(0.0)
        state |= {name: torch.zeros_like(parameter) for name in KEPT}
    return state


@kernel
def _step(gradients, rates, values, moments, squares, means):
    length, to_moment, to_square, root = rates[0], rates[1], rates[2], rates[3]
    epsilon, scale, share = rates[4], rates[5], rates[6]
    for k in range(len(values)):
        gradient = scale * gradients[k]
        moment = moments[k] + to_moment * (gradient - moments[k])
        square = squares[k] + to_square * (gradient * gradient - squares[k])
        value = values[k] - length * moment / (root * np.sqrt(square) + epsilon)
        moments[k], squares[k], values[k] = moment, square, value
        means[k] += share * (value - means[k])
