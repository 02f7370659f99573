# SPDX-License-Identifier: GPL-3.0-or-later
"""Training of one form of the error estimator: network, loss and moving mean of its weights (methods 12.2, 12.3)."""

from __future__ import annotations

import numpy as np
import torch
from torch import nn

from ...patchnet_addon.sampling.plus.features import HIGHEST, LOWEST, features_of
from ...patchnet_addon.sampling.plus.forms import Form, Plane
from ...patchnet_addon.sampling.plus.weights import Network, layer_sizes

_MOVING = 0.002  # share of the present weights in the moving mean, per step
_POWER = 1.25  # 1 is Poisson's distribution, 2 the gamma distribution: higher values weigh small errors more
_FIRST_MEAN = 0.3  # initial ratio of error and scale


class FormLearner:
    """Network of a form, trained on windows of pixels and their squared errors.

    mean, deviation: (F,) float32 of the features, for normalization. unit: mean squared error of all pixels, the unit
    of the loss.
    """

    def __init__(self, form: Form, windows: np.ndarray, unit: float, rate: float, seed: int) -> None:
        """Create the network of a form; windows: (C, 9, N) of all planes of some pixels, to normalize features."""
        self.form, self.unit, self.losses = form, max(unit, 1e-12), list[float]()
        features, _ = features_of(windows, form, tuple(Plane))
        self.mean, self.deviation = features.mean(axis=1), features.std(axis=1) + np.float32(1e-3)
        count, hidden, _, outputs = layer_sizes(form)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            layers = nn.Linear(count, hidden), nn.Linear(hidden, hidden), nn.Linear(hidden, outputs)
        self.skip = nn.Parameter(torch.zeros(count))
        with torch.no_grad():
            layers[-1].weight.zero_()
            layers[-1].bias.copy_(torch.tensor([0.0, _FIRST_MEAN]))
        self.model = nn.Sequential(layers[0], nn.ReLU(), layers[1], nn.ReLU(), layers[2])
        self.parameters = [*self.model.parameters(), self.skip]
        self.moving = [parameter.detach().clone() for parameter in self.parameters]
        self.optimizer = torch.optim.Adam(self.parameters, rate)
        self.steps = 0

    def step(self, windows: np.ndarray, errors: np.ndarray, rate: float) -> None:
        """Take one step with windows (C, 9, B) of pixels and squared errors (B,), at a learning rate."""
        features, scale = features_of(windows, self.form, tuple(Plane))
        inputs = ((features - self.mean[:, None]) / self.deviation[:, None]).T
        expected = torch.from_numpy(scale) * self._outputs(torch.from_numpy(np.ascontiguousarray(inputs)))
        # Deviance of Tweedie's distribution up to constants: its minimum is the mean for any distribution.
        # A constant mean of all pixels has a deviance of 1.
        ratio, true = expected / self.unit, torch.from_numpy(errors / np.float32(self.unit))
        loss = ((_POWER - 1) * ratio ** (2 - _POWER) + (2 - _POWER) * true * ratio ** (1 - _POWER)).mean()
        for group in self.optimizer.param_groups:
            group["lr"] = rate
        self.optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        self.optimizer.step()
        self.steps += 1
        self.losses.append(loss.item())
        share = max(_MOVING, 1 / self.steps)
        with torch.no_grad():
            for moving, parameter in zip(self.moving, self.parameters, strict=True):
                moving.lerp_(parameter, share)

    def network(self) -> Network:
        """Network of the moving mean, for raw features."""
        *arrays, skip = (moving.numpy().astype(np.float64) for moving in self.moving)
        (first, bias), *others = zip(arrays[::2], arrays[1::2], strict=True)
        first, skip = first / self.deviation, skip / self.deviation
        others[-1][1][1] -= skip @ self.mean  # of the second output
        layers = [(first, bias - first @ self.mean), *others]
        return Network(
            tuple((matrix.astype(np.float32), offset.astype(np.float32)) for matrix, offset in layers),
            skip.astype(np.float32),
        )

    def _outputs(self, inputs: torch.Tensor) -> torch.Tensor:
        """Expected squared error over the squared scale, (B,)."""
        variance, mean = self.model(inputs).unbind(1)
        return (mean + inputs @ self.skip) ** 2 + torch.exp(variance.clamp(LOWEST, HIGHEST))
