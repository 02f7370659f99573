# SPDX-License-Identifier: GPL-3.0-or-later
"""PatchNet as a torch module, for training; `encode.py` and `decode.py` are the same network without torch."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

from ..runtime.bounds import DEFAULT_LOOKAHEAD
from .decode import OUTPUT_LOW, OUTPUT_RANGE
from .encoders import CHANNELS, MLP, EncoderKind, patch_side
from .harmonics import harmonic_terms
from .kinds import PAPER, SIDE_BY_SIDE, NetworkKind
from .torch_convolutions import TorchLayer, convolved_codes
from .weights import MODULATED, Weights


@dataclass(frozen=True)
class MixturePlace:
    """Inputs of a luminance mixture that tell the place, see `MixtureInputs`.

    corner_codes: (N, 8, 10), of which the first four numbers are used. view: (N, 9). covered: (N, 64). luminances:
    (N, 65).
    """

    corner_codes: Tensor
    view: Tensor
    covered: Tensor
    luminances: Tensor


class PatchNet(nn.Module):
    """Encoder of patches, trilinear interpolation of the eight corners' codes, decoder (methods 7.9 to 7.15, 11.1)."""

    def __init__(
        self,
        seed: int = 0,
        lookahead: int = DEFAULT_LOOKAHEAD,
        kind: NetworkKind = PAPER,
        encoder: EncoderKind = MLP,
    ) -> None:
        """Initialise a network by He's method, which depends on `seed` alone, for patches `lookahead` levels deep."""
        super().__init__()
        self.lookahead, self.kind, self.encoder_kind = lookahead, kind, encoder
        self.encoder = nn.ModuleList(_encoder_layers(encoder, lookahead))
        self.decoder = nn.ModuleList(_linear_layers(kind.decoder))
        self.set_weights(Weights.random(seed, lookahead=lookahead, kind=kind, encoder=encoder))

    @classmethod
    def from_weights(cls, weights: Weights) -> PatchNet:
        """Network with a copy of `weights`."""
        model = cls(lookahead=weights.lookahead, kind=weights.kind, encoder=weights.encoder_kind)
        model.set_weights(weights)
        return model

    def set_weights(self, weights: Weights) -> None:
        """Copy `weights` into the parameters."""
        self.load_state_dict({name: torch.from_numpy(array.copy()) for name, array in weights.arrays().items()})

    def to_weights(self, metadata: dict[str, Any] | None = None) -> Weights:
        """Copy of the parameters as plain arrays."""
        arrays = {name: value.detach().float().cpu().numpy().copy() for name, value in self.state_dict().items()}
        return Weights.from_arrays(arrays, metadata, self.lookahead, self.kind, self.encoder_kind)

    def encode(self, patches: Tensor) -> Tensor:
        """Codes (..., 10) of patches (..., S), flattened from cells z, y, x, channel; S = 2560 for two levels."""
        if not self.encoder_kind.convolves:
            return _run_layers(self.encoder, patches)
        side = patch_side(self.lookahead)
        cells = patches.reshape(-1, side, side, side, CHANNELS).movedim(-1, 1)
        codes = self.convolve(cells)
        return codes.view(*patches.shape[:-1], codes.shape[-1])  # also of no patches

    def convolve(self, cells: Tensor, dtype: torch.dtype = torch.float32) -> Tensor:
        """Codes (C, 10) of patches (C, 5, S, S, S), of an encoder that convolves; see `convolved_codes`."""
        layers: list[TorchLayer] = [(layer.weight, layer.bias) for layer in self.encoder]  # type: ignore[misc]
        return convolved_codes(self.encoder_kind.stages(self.lookahead), layers, cells, dtype)

    def decode(self, codes: Tensor, direction: Tensor, up: Tensor, ratio: Tensor) -> Tensor:
        """Coverage and luminance (N, 2) in [-1, 2] for codes (N, 10), unit vectors (N, 3) and ratios (N,)."""
        inputs = _ray_inputs(codes, direction, up, ratio)
        return OUTPUT_LOW + OUTPUT_RANGE * torch.sigmoid(_run_layers(self.decoder, inputs))

    def decode_mixture(
        self, codes: Tensor, place: MixturePlace, direction: Tensor, up: Tensor, ratio: Tensor
    ) -> Tensor:
        """Coverage in [-1, 2] and luminance (N, 2), see `decode`, of a luminance mixture (methods 11.1)."""
        rays = _ray_inputs(codes, direction, up, ratio)
        corners = place.corner_codes[:, :, :SIDE_BY_SIDE].flatten(1)
        outputs = _run_layers(self.decoder, torch.cat([rays, corners, place.view, place.covered], dim=-1))
        covered = torch.cat([place.covered, torch.ones_like(place.covered[:, :1])], dim=-1)
        logits = outputs[:, 1:].masked_fill(covered <= 0, -torch.inf)
        shares = covered * torch.exp(logits - logits.amax(dim=-1, keepdim=True))
        shares = shares / shares.sum(dim=-1, keepdim=True)
        coverage = OUTPUT_LOW + OUTPUT_RANGE * torch.sigmoid(outputs[:, 0])
        return torch.stack([coverage, (shares * place.luminances).sum(-1)], dim=-1)

    def forward(self, patches: Tensor, entry: Tensor, direction: Tensor, up: Tensor, ratio: Tensor) -> Tensor:
        """Coverage and luminance (N, 2) in [-1, 2].

        Of a network of the paper's kind. patches: (N, 8, S) of the voxel's corners, x fastest. entry: (N, 3) point in
        the voxel, [0, 1]^3 (methods 7.11). direction, up: (N, 3). ratio: (N,).
        """
        return self.decode(interpolate(self.encode(patches), entry), direction, up, ratio)


def _ray_inputs(codes: Tensor, direction: Tensor, up: Tensor, ratio: Tensor) -> Tensor:
    """Inputs (N, 42) of code and ray."""
    x, y, z = direction.unbind(-1)
    harmonics = torch.stack(harmonic_terms(x, y, z), dim=-1)  # (N, 25)
    modulated = codes[:, :MODULATED] * harmonics[:, :MODULATED]
    return torch.cat([modulated, codes[:, MODULATED:], direction, up, ratio[:, None], harmonics], dim=-1)


def interpolate(codes: Tensor, entry: Tensor) -> Tensor:
    """Trilinear mean (N, 10) of the codes (N, 8, 10) of eight corners, x fastest, at points (N, 3) in [0, 1]^3."""
    shares = torch.stack([1 - entry, entry], dim=-1)  # (N, axis, side)
    x, y, z = shares.unbind(1)
    factors = z[:, :, None, None] * y[:, None, :, None] * x[:, None, None, :]  # (N, 2, 2, 2)
    return torch.einsum("no,noc->nc", factors.reshape(-1, 8), codes)


def _encoder_layers(encoder: EncoderKind, lookahead: int) -> list[nn.Module]:
    """Layers without values; those of kernels know these alone, strides and padding are the stages' affair."""
    if not encoder.convolves:
        return list(_linear_layers(encoder.sizes(lookahead)))
    return [
        nn.Linear(shape[1], shape[0]) if len(shape) == 2 else nn.Conv3d(shape[1], shape[0], shape[2])
        for shape in encoder.shapes(lookahead)
    ]


def _linear_layers(sizes: tuple[int, ...]) -> list[nn.Linear]:
    return [nn.Linear(first, second) for first, second in itertools.pairwise(sizes)]


def _run_layers(layers: nn.ModuleList, values: Tensor) -> Tensor:
    for layer in layers[:-1]:
        values = torch.relu(layer(values))
    return layers[-1](values)
