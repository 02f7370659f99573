# SPDX-License-Identifier: GPL-3.0-or-later
"""Decoder of a batch on the CPU, forward and backward: its matrix products by torch, one kernel each between them.

The same as `PatchNet.decode` and `PatchNet.decode_mixture` by torch's own steps, which are so many that threads which
learn side by side would wait for the interpreter's lock again and again.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from ..data.tensor_batch import TensorBatch
from .cpu_layers import add_bias, mask_gradient
from .decoder_inputs import codes_gradient, decoder_inputs
from .decoder_outputs import limit_outputs, mix_luminances, outputs_gradient


class CpuDecoder(torch.autograd.Function):
    """Coverage and luminance (V R, 2) of codes (V, 8, 10); the gradient goes to the codes and to the layers."""

    @staticmethod
    def forward(ctx: Any, eight: Tensor, batch: TensorBatch, *layers: Tensor) -> Tensor:
        """Results of `layers`, matrices (out, in) and biases (out,) in turn, float32; ReLUs stand between them."""
        values = [torch.from_numpy(decoder_inputs(eight.detach().numpy(), batch))]
        matrices, biases = layers[::2], layers[1::2]
        for matrix, bias in zip(matrices[:-1], biases[:-1], strict=True):
            values.append(add_bias(values[-1] @ matrix.t(), bias))
        outputs = torch.addmm(biases[-1], values[-1], matrices[-1].t()).numpy()
        near = batch.nearby
        if near is None:
            found, ctx.slopes = limit_outputs(outputs)
        else:
            covered, luminances = (part.flatten(0, 1).numpy() for part in (near.covered, near.luminances))
            found, ctx.slopes = mix_luminances(outputs, covered, luminances)
        ctx.save_for_backward(*matrices)
        ctx.values, ctx.entry = values, batch.entry
        return torch.from_numpy(found)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:  # type: ignore[override]
        """Gradients of codes and layers."""
        after = torch.from_numpy(outputs_gradient(ctx.slopes, gradient.numpy()))
        of_bias = after.sum(0)
        of_layers: list[Tensor] = []
        for matrix, values in zip(reversed(ctx.saved_tensors), reversed(ctx.values), strict=True):
            of_layers[:0] = [after.t() @ values, of_bias]
            after = after @ matrix
            if values is not ctx.values[0]:
                after, of_bias = mask_gradient(after, values)
        of_codes = codes_gradient(after.numpy(), ctx.values[0].numpy(), ctx.entry.numpy())
        return torch.from_numpy(of_codes), None, *of_layers
