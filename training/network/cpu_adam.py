# SPDX-License-Identifier: GPL-3.0-or-later
"""Adam's step with clipped gradients, and the moving mean of the parameters, on the CPU, in few passes over the memory.

The same as `torch.nn.utils.clip_grad_norm_`, `torch.optim.Adam` and `torch.lerp` after each other, and on that
optimiser's own state, so that a run may go on with either. Parameters and what is kept of them do not fit a core's
cache: the time goes with the passes over them, which threads share where there are many.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ...patchnet_addon.network.lanes import LANES, add_product, load, zeros
from ...patchnet_addon.runtime.kernels import device, kernel
from ...patchnet_addon.runtime.threads import limit_threads, run_parts, thread_count
from ...patchnet_addon.runtime.vectors import total
from .flat_memory import flat_memory
from .tiled_packing import PackedMatrices, pack_piece

KEPT = "exp_avg", "exp_avg_sq"  # torch's names of both moments
LEAST_NORM = 1e-6  # as torch clips
_PIECE = 1 << 16  # parameters, about: what a thread moves before it goes on to the next ones
_PARTS_ALONE = 2


class CpuAdam:
    """Optimiser that takes the steps of `optimizer`, and moves the means of its parameters after each.

    means: of the parameters in their order. clip: greatest norm of all gradients, 0 for none. packed: matrices among
    the parameters that are packed as soon as they are moved. All lie on the CPU in float32, from now on in flat memory,
    and the optimiser has one group with a rate, betas and epsilon, and nothing else. Goes on from the state that the
    optimiser has.
    """

    def __init__(
        self,
        optimizer: torch.optim.Adam,
        means: Sequence[Tensor],
        clip: float = 0.0,
        packed: PackedMatrices | None = None,
    ) -> None:
        (self._group,) = optimizer.param_groups
        assert not any(self._group[name] for name in ("weight_decay", "amsgrad", "maximize"))
        parameters: list[Tensor] = self._group["params"]
        self._states = [state_of(optimizer, parameter) for parameter in parameters]
        self._steps, self._clip, self._packed = int(self._states[0]["step"]), clip, packed
        kept = [[state[name] for state in self._states] for name in KEPT]
        self._moved = tuple(flat_memory(tensors).numpy() for tensors in (parameters, *kept, means))
        piece = max(1, _PIECE // packed.step) * packed.step if packed else _PIECE
        ends = np.cumsum([parameter.numel() for parameter in parameters])
        cuts = [np.arange(end - parameter.numel(), end, piece) for end, parameter in zip(ends, parameters, strict=True)]
        self._cuts = np.concatenate([*cuts, ends[-1:]])  # no piece has numbers of two parameters

    def step(self, parts: Sequence[Tensor], *, share: float) -> None:
        """Take a step along the sum of the gradients (n,) of the parts of a step, which is made in memory of the first.

        Means become (1 - share) mean + share parameter. Of more than two parts runs on as many threads as `run_parts`
        may use; for two, to wake another one takes as long as it would save.
        """
        with limit_threads(1 if len(parts) <= _PARTS_ALONE else thread_count()):
            self._take([part.numpy() for part in parts], share)

    def _take(self, parts: Sequence[np.ndarray], share: float) -> None:
        self._steps += 1
        own, *others = parts
        pieces = len(self._cuts) - 1
        lengths = np.zeros(pieces)
        for other in others or ([own[:0]] if self._clip else []):
            run_parts(_add, pieces, self._cuts, own, other, lengths)
        norm = float(np.sqrt(lengths.sum()))
        scale = min(1.0, self._clip / (norm + LEAST_NORM)) if self._clip else 1.0
        first, second = self._group["betas"]
        length = self._group["lr"] / (1 - first**self._steps)  # both moments began at 0
        root = (1 - second**self._steps) ** -0.5
        rates = np.array([length, 1 - first, 1 - second, root, self._group["eps"], scale, share], np.float32)
        if self._packed is None:
            run_parts(_move, pieces, self._cuts, own, rates, *self._moved)
        else:
            packed = self._packed.current()
            run_parts(_move_and_pack, pieces, self._cuts, own, rates, *self._moved, self._packed.sizes, packed)

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
def _add(first, last, cuts, own, other, lengths):
    """Add other gradients to one's own in some pieces, if there are any; squared lengths of the sums."""
    for piece in range(first, last):
        total = own[cuts[piece] : cuts[piece + 1]]
        if len(other) > 0:
            more = other[cuts[piece] : cuts[piece + 1]]
            for k in range(len(total)):
                total[k] += more[k]
        lengths[piece] = _squared_length(total)


@device
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
def _move(first, last, cuts, gradients, rates, values, moments, squares, means):
    """Move the parameters of some pieces, and what is kept of them."""
    for piece in range(first, last):
        begin, end = cuts[piece], cuts[piece + 1]
        _step(gradients[begin:end], rates, values[begin:end], moments[begin:end], squares[begin:end], means[begin:end])


@kernel
def _move_and_pack(first, last, cuts, gradients, rates, values, moments, squares, means, sizes, packed):
    """The same, and pack what is moved."""
    for piece in range(first, last):
        begin, end = cuts[piece], cuts[piece + 1]
        _step(gradients[begin:end], rates, values[begin:end], moments[begin:end], squares[begin:end], means[begin:end])
        pack_piece(values, begin, end, sizes, packed)


@device
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
