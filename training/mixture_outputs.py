# SPDX-License-Identifier: GPL-3.0-or-later
"""Coverage and luminance from the outputs of the mixture's decoder, and their gradient, in one kernel each on the CPU.

The same as the end of `PatchNet.decode_mixture`. The kernels are serial, since several threads learn from a part of a
step each.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..patchnet_addon.network.compiled_layers import exponential
from ..patchnet_addon.network.decode import OUTPUT_LOW, OUTPUT_RANGE
from ..patchnet_addon.network.kinds import COVERING, MIXED
from ..patchnet_addon.runtime.kernels import kernel

_LOW, _RANGE = np.float32(OUTPUT_LOW), np.float32(OUTPUT_RANGE)
_LEAST = np.float32(-80)  # powers of e below count as this one


class MixtureOutputs(torch.autograd.Function):
    """Coverage in [-1, 2] and luminance (N, 2) of a luminance mixture; the gradient goes to the decoder's outputs."""

    @staticmethod
    def forward(ctx: Any, outputs: Tensor, covered: Tensor, luminances: Tensor) -> Tensor:
        """Results for outputs (N, 66), and covered (N, 64) and luminances (N, 65) of `MixtureInputs`; on the CPU."""
        result = np.empty((len(outputs), 2), np.float32)
        slopes = np.empty(outputs.shape, np.float32)
        _mix(outputs.detach().numpy(), covered.numpy(), luminances.numpy(), result, slopes)
        ctx.slopes = slopes
        return torch.from_numpy(result)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:  # type: ignore[override]
        """Gradient (N, 66) of the outputs."""
        result = torch.from_numpy(ctx.slopes) * gradient[:, 1:]
        result[:, 0] = torch.from_numpy(ctx.slopes[:, 0]) * gradient[:, 0]
        return result, None, None


@kernel
def _mix(outputs, covered, luminances, result, slopes):
    """slopes: (N, 66) of coverage by the first output, of luminance by the others."""
    weights = np.empty(MIXED, np.float32)
    for row in range(len(outputs)):
        logits, there, lights, slope = outputs[row, 1:], covered[row], luminances[row], slopes[row]
        largest = logits[COVERING]
        for k in range(COVERING):
            largest = max(largest, logits[k]) if there[k] > 0 else largest
        for k in range(COVERING):
            power = min(max(logits[k] - largest, _LEAST), np.float32(0))
            weights[k] = there[k] * exponential(power)
        weights[COVERING] = exponential(max(logits[COVERING] - largest, _LEAST))
        total, light = np.float32(0), np.float32(0)
        for k in range(MIXED):
            total += weights[k]
            light += weights[k] * lights[k]
        mean = light / total
        for k in range(MIXED):
            slope[1 + k] = weights[k] / total * (lights[k] - mean)
        power = min(max(-outputs[row, 0], _LEAST), -_LEAST)
        sigmoid = np.float32(1) / (np.float32(1) + exponential(power))
        result[row, 0], result[row, 1] = _LOW + _RANGE * sigmoid, mean
        slope[0] = _RANGE * sigmoid * (np.float32(1) - sigmoid)
