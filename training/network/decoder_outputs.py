# SPDX-License-Identifier: GPL-3.0-or-later
"""Coverage and luminance from the decoder's outputs, and how they change with each output, in one kernel on the CPU.

The same as the end of `PatchNet.decode` and `PatchNet.decode_mixture`. The kernels are serial, since several threads
learn from a part of a step each.
"""

from __future__ import annotations

import numpy as np

from ...patchnet_addon.network.compiled_layers import exponential
from ...patchnet_addon.network.decode import OUTPUT_LOW, OUTPUT_RANGE
from ...patchnet_addon.network.kinds import COVERING, MIXED
from ...patchnet_addon.runtime.kernels import device, kernel

_LOW, _RANGE = np.float32(OUTPUT_LOW), np.float32(OUTPUT_RANGE)
_LEAST = np.float32(-80)  # powers of e below count as this one


def limit_outputs(outputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coverage and luminance (N, 2) in [-1, 2] of the paper's decoder's outputs (N, 2), and their slopes (N, 2)."""
    result, slopes = np.empty(outputs.shape, np.float32), np.empty(outputs.shape, np.float32)
    _limit(outputs, result, slopes)
    return result, slopes


def mix_luminances(outputs: np.ndarray, covered: np.ndarray, luminances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coverage in [-1, 2] and luminance (N, 2) of a mixture's outputs (N, 66), and their slopes (N, 66).

    covered (N, 64) and luminances (N, 65) are those of `MixtureInputs`. The first slope is that of coverage by the
    first output, the others are those of luminance by the others.
    """
    result, slopes = np.empty((len(outputs), 2), np.float32), np.empty(outputs.shape, np.float32)
    _mix(outputs, covered, luminances, result, slopes)
    return result, slopes


def outputs_gradient(slopes: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """Gradient of the outputs (N, 2) or (N, 66) by their slopes, for that of coverage and luminance (N, 2)."""
    result = np.empty(slopes.shape, np.float32)
    _scale(slopes, gradient, result)
    return result


@device
def _bounded(output):
    """Value in [-1, 2] of an output, and its slope."""
    power = min(max(-output, _LEAST), -_LEAST)
    sigmoid = np.float32(1) / (np.float32(1) + exponential(power))
    return _LOW + _RANGE * sigmoid, _RANGE * sigmoid * (np.float32(1) - sigmoid)


@kernel
def _limit(outputs, result, slopes):
    for row in range(len(outputs)):
        for k in range(2):
            result[row, k], slopes[row, k] = _bounded(outputs[row, k])


@kernel
def _mix(outputs, covered, luminances, result, slopes):
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
        result[row, 0], slope[0] = _bounded(outputs[row, 0])
        result[row, 1] = mean


@kernel
def _scale(slopes, gradient, result):
    for row in range(len(slopes)):
        result[row, 0] = slopes[row, 0] * gradient[row, 0]
        for k in range(1, slopes.shape[1]):
            result[row, k] = slopes[row, k] * gradient[row, 1]
