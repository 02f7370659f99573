# SPDX-License-Identifier: GPL-3.0-or-later
"""Adam's step with clipped gradients, and the moving mean of the parameters, on the CPU, in few passes over the memory.

The same as `torch.nn.utils.clip_grad_norm_`, `torch.optim.Adam` and `torch.lerp` after each other, and on that
optimiser's own state, so that a run may go on with either. Parameters and what is kept of them do not fit a core's
cache: the time goes with the passes over them, which all threads share.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from ...patchnet_addon.network.lanes import LANES, add_product, load, zeros
from ...patchnet_addon.runtime.kernels import kernel
from ...patchnet_addon.runtime.threads import limit_threads, run_parts, thread_count
from ...patchnet_addon.runtime.vectors import total

KEPT = "exp_avg", "exp_avg_sq"  # torch's names of both moments
LEAST_NORM = 1e-6  # as torch clips
_PIECE = 1 << 16  # parameters that one thread takes at once
_PARTS_ALONE = 2
_Arrays = list[np.ndarray]


class _Piece(NamedTuple):
    """Piece of a parameter: its number, its place there, and memory of it, of its moments and of its mean."""

    number: int
    place: slice
    values: np.ndarray
    moments: np.ndarray
    squares: np.ndarray
    means: np.ndarray


def _flat(tensors: Sequence[Tensor]) -> _Arrays:
    """Memory of tensors; refuses what would have to be copied."""
    return [tensor.detach().view(-1).numpy() for tensor in tensors]


class CpuAdam:
    """Optimiser that takes the steps of `optimizer`, and moves the means of its parameters after each.

    means: of the parameters in their order. clip: greatest norm of all gradients, 0 for none. All lie on the CPU in
    float32, and the optimiser has one group with a rate, betas and epsilon, and nothing else. Goes on from the state
    that the optimiser has.
    """

    def __init__(self, optimizer: torch.optim.Adam, means: Sequence[Tensor], clip: float = 0.0) -> None:
        (self._group,) = optimizer.param_groups
        assert not any(self._group[name] for name in ("weight_decay", "amsgrad", "maximize"))
        parameters: list[Tensor] = self._group["params"]
        self._states = [state_of(optimizer, parameter) for parameter in parameters]
        self._steps, self._clip = int(self._states[0]["step"]), clip
        moments, squares = ([state[name] for state in self._states] for name in KEPT)
        # Once: to find the memory of every tensor anew takes as long as a third of the step.
        self._pieces = [
            _Piece(number, slice(first, first + _PIECE), *(array[first : first + _PIECE] for array in arrays))
            for number, arrays in enumerate(zip(*map(_flat, (parameters, moments, squares, means)), strict=True))
            for first in range(0, len(arrays[0]), _PIECE)
        ]

    def step(self, parts: Sequence[Sequence[Tensor]], *, share: float) -> None:
        """Take a step along the sum of the gradients of the parts of a step, which is made in memory of the first.

        Means become (1 - share) mean + share parameter. Of more than two parts runs on as many threads as `run_parts`
        may use; for two, to wake another one takes as long as it would save.
        """
        with limit_threads(1 if len(parts) <= _PARTS_ALONE else thread_count()):
            self._take(parts, share)

    def _take(self, parts: Sequence[Sequence[Tensor]], share: float) -> None:
        self._steps += 1
        own, *others = [_flat([gradient.contiguous() for gradient in part]) for part in parts]
        lengths = np.zeros(len(self._pieces))
        if others or self._clip:
            run_parts(self._add_up, len(self._pieces), own, others, lengths)
        norm = float(np.sqrt(lengths.sum()))
        scale = min(1.0, self._clip / (norm + LEAST_NORM)) if self._clip else 1.0
        first, second = self._group["betas"]
        length = self._group["lr"] / (1 - first**self._steps)  # both moments began at 0
        root = (1 - second**self._steps) ** -0.5
        numbers = length, 1 - first, 1 - second, root, self._group["eps"], scale, share
        run_parts(self._move, len(self._pieces), own, np.array(numbers, np.float32))

    def _add_up(self, first: int, last: int, own: _Arrays, others: list[_Arrays], lengths: np.ndarray) -> None:
        """Add the other parts' gradients to the first one's in some pieces; squared lengths of these."""
        for index in range(first, last):
            piece = self._pieces[index]
            total = own[piece.number][piece.place]
            for other in others:
                _add(total, other[piece.number][piece.place])
            lengths[index] = _squared_length(total)

    def _move(self, first: int, last: int, gradients: _Arrays, rates: np.ndarray) -> None:
        for piece in self._pieces[first:last]:
            _step(gradients[piece.number][piece.place], rates, *piece[2:])

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
def _add(totals, others):
    for k in range(len(totals)):
        totals[k] += others[k]


@kernel
def _squared_length(values):
    """Sum of the squares of values."""
    whole = len(values) // (2 * LANES) * 2 * LANES
    first, second = zeros(), zeros()
    for k in range(0, whole, 2 * LANES):
        first = add_product(first, load(values, k), load(values, k))
        second = add_product(second, load(values, k + LANES), load(values, k + LANES))
    length = float(total(first + second))
    for k in range(whole, len(values)):
        length += values[k] * values[k]
    return length


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
