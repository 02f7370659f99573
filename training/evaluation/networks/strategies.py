# SPDX-License-Identifier: GPL-3.0-or-later
"""Strategies of map networks from their weights files (methods 3.9-3.11); torch is imported when one is made."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ....patchnet_addon.runtime.errors import PatchNetError, WeightsFileError
from ....patchnet_addon.runtime.threads import thread_count
from ....patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ....patchnet_addon.sampling.strategy import Strategy
from ...run.torch_threads import torch_threads
from .gbuffer import NEEDS, gbuffer
from .map_file import read_map

if TYPE_CHECKING:
    import torch


def map_strategy(path: Path) -> Strategy:
    """Strategy `witw20`, `kkr18` or `ss-unet` of a weights file that `patchnet lab train-maps` has written.

    Raises PatchNetError without torch, and WeightsFileError for a file that is missing, foreign, damaged, or of other
    networks than those of this version.
    """
    try:
        import torch
    except ImportError as cause:
        raise PatchNetError(f"Sampling maps need torch ({cause}): install patchnet-blender[train]") from cause
    from .registry import NETWORKS

    weights, notes = read_map(path)
    network = NETWORKS.get(notes.get("network", ""))
    if network is None:
        raise WeightsFileError(f"{path} is of the network {notes.get('network')!r}, which this version does not have")
    model = network.build()
    _fill(model, weights, path)

    def score(buffers: PixelBuffers) -> np.ndarray:
        planes = torch.from_numpy(network.planes(gbuffer(buffers)))
        with torch_threads(thread_count()), torch.inference_mode():
            return network.scores(model, planes[None])[0].numpy().ravel()

    made = f"{notes.get('steps', 0):,} steps on {notes.get('frames', 0):,} frames"
    return Strategy(
        name=network.strategy,
        title=network.title,
        description=f"{network.description}; retrained here, {made}",
        needs=NEEDS,
        score=score,
        quantity=network.quantity,
        maximum=network.maximum,
        group="screen-space",
    )


def _fill(model: torch.nn.Module, weights: dict[str, Any], path: Path) -> None:
    """Give a network its weights; raises WeightsFileError unless they are exactly its own, and finite."""
    import torch

    wanted = {name: tuple(value.shape) for name, value in model.state_dict().items()}
    found = {name: value.shape for name, value in weights.items()}
    if wanted != found:
        raise WeightsFileError(f"{path} has weights of other layers than its network: train it anew")
    if not all(np.isfinite(value).all() for value in weights.values()):
        raise WeightsFileError(f"{path} has weights that are not finite: train it anew, at a lower rate")
    model.load_state_dict({name: torch.from_numpy(np.array(value)) for name, value in weights.items()})
    model.eval()
