# SPDX-License-Identifier: GPL-3.0-or-later
"""Coverage and luminance from the decoder's outputs, and how they change with each output, for kernels.

The same as the end of `PatchNet.decode` and `PatchNet.decode_mixture`. A mixture's outputs stand in the order of
luminances here, coverage behind them: then they lie in vectors as what cells cover does.
"""

from __future__ import annotations

import numpy as np

from ...patchnet_addon.network.compiled_layers import exponential
from ...patchnet_addon.network.decode import OUTPUT_LOW, OUTPUT_RANGE
from ...patchnet_addon.network.kinds import COVERING, MIXED
from ...patchnet_addon.network.lanes import LANES, add_product, load, splat_lanes, spread, zeros
from ...patchnet_addon.runtime.kernels import lean_device
from ...patchnet_addon.runtime.vectors import larger, largest, less, select, store, total
from .lane_exponential import falling_exponential

_LOW, _RANGE = np.float32(OUTPUT_LOW), np.float32(OUTPUT_RANGE)
_LEAST = np.float32(-80)  # powers of e below count as this one
_OWN = COVERING  # output of the voxel's own luminance
_COVERAGE = MIXED
assert COVERING % LANES == 0


@lean_device
def limit_outputs(outputs, found, slopes):
    """Write coverage and luminance (n, 2) in [-1, 2] of the paper's decoder's outputs (m, >= 2), and slopes alike."""
    for row in range(len(found)):
        for k in range(2):
            found[row, k], slopes[row, k] = _bounded(outputs[row, k])


@lean_device
def mix_luminances(outputs, covered, luminances, found, slopes):
    """Write coverage in [-1, 2] and luminance (n, 2) of a mixture's outputs (m, >= 66), and their slopes alike.

    covered (n, 64) and luminances (n, 65) are those of `MixtureInputs`. The slope of the last output is that of
    coverage by it, the others are those of luminance by theirs.
    """
    for row in range(len(found)):
        logits, there, lights, weights = outputs[row], covered[row], luminances[row], slopes[row]
        high = _largest_logit(logits, there)
        weight, light = _weigh(logits, high, there, lights, weights)
        own = exponential(max(logits[_OWN] - high, _LEAST))
        share = np.float32(1) / (weight + own)
        mean = (light + own * lights[_OWN]) * share
        for k in range(0, COVERING, LANES):  # weights become slopes
            beyond = load(lights, k) - splat_lanes(mean)
            store(weights, k, load(weights, k) * splat_lanes(share) * beyond)
        weights[_OWN] = own * share * (lights[_OWN] - mean)
        found[row, 0], weights[_COVERAGE] = _bounded(logits[_COVERAGE])
        found[row, 1] = mean


@lean_device
def _largest_logit(logits, covered):
    """Largest of the logits of what covers something, and of the voxel's own luminance."""
    high = spread(logits, _OWN)
    for k in range(0, COVERING, LANES):
        high = select(less(zeros(), load(covered, k)), larger(load(logits, k), high), high)
    return largest(high)


@lean_device
def _weigh(logits, high, covered, lights, weights):
    """Write the weights of covering cells; returns their sum, and that of luminances with them."""
    weight, light, beyond = zeros(), zeros(), splat_lanes(high)
    for k in range(0, COVERING, LANES):
        part = load(covered, k) * falling_exponential(load(logits, k) - beyond)
        store(weights, k, part)
        weight, light = weight + part, add_product(light, part, load(lights, k))
    return total(weight), total(light)


@lean_device
def scale_outputs(slopes, gradient, after):
    """Write the gradient of outputs (m, width) by their slopes alike, for that of coverage and luminance (n, 2).

    Slopes of a row of no view are zeros.
    """
    coverage = _COVERAGE if slopes.shape[1] > MIXED else 0
    for row in range(len(slopes)):
        luminance = gradient[row, 1] if row < len(gradient) else np.float32(0)
        for k in range(slopes.shape[1]):
            after[row, k] = slopes[row, k] * luminance
        if row < len(gradient):
            after[row, coverage] = slopes[row, coverage] * gradient[row, 0]


@lean_device
def _bounded(output):
    """Value in [-1, 2] of an output, and its slope."""
    power = min(max(-output, _LEAST), -_LEAST)
    sigmoid = np.float32(1) / (np.float32(1) + exponential(power))
    return _LOW + _RANGE * sigmoid, _RANGE * sigmoid * (np.float32(1) - sigmoid)
