# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of map networks, and their strategies (methods 3.9-3.11); imports torch only for a strategy."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ....patchnet_addon.runtime.errors import WeightsFileError
from ....patchnet_addon.runtime.file_kinds import arrays_kind
from ....patchnet_addon.runtime.files import content_hash, read_arrays, write_arrays
from ....patchnet_addon.runtime.threads import thread_count
from ....patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ....patchnet_addon.sampling.strategy import Strategy
from ...file_kinds import CHECKPOINT as CHECKPOINT_KIND
from ...file_kinds import TRAINING_LOG
from ...run import torch_threads
from ...run.run_files import CHECKPOINT, LOG
from . import NAMES
from .frames import NEEDS, gbuffer

if TYPE_CHECKING:
    import torch

    from .map_network import MapNetwork

KIND = "sampling-map"
MAP = "sampling_map.safetensors"
FRAMES = "frames"  # folder of rendered frames
RUN_FILES = {CHECKPOINT: CHECKPOINT_KIND, LOG: TRAINING_LOG, MAP: arrays_kind(KIND)}


def save_map(path: Path, network: str, weights: Mapping[str, np.ndarray], notes: Mapping[str, Any]) -> None:
    """Write the weights of the network called `network`, and notes on its training; raises OutputError."""
    write_arrays(path, weights, dict(notes) | {"network": network}, KIND)


def read_map(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Weights by name, and notes on their training; raises WeightsFileError."""
    return read_arrays(path, KIND, WeightsFileError)


def map_hash(path: Path) -> str:
    """Hash (32 hex digits) of a file's weights; raises as `read_map`."""
    return content_hash(read_map(path)[0])


def map_networks() -> dict[str, MapNetwork]:
    """Map networks by name; needs torch."""
    from .kuznetsov import KUZNETSOV
    from .unet import UNET
    from .weiss import WEISS

    return dict(zip(NAMES, (WEISS, KUZNETSOV, UNET), strict=True))


def map_strategy(path: Path) -> Strategy:
    """Strategy `witw20`, `kkr18` or `ss-unet` of a weights file of `patchnet lab train-maps`.

    Raises WeightsFileError for a file that is missing, damaged, or of another network or version.
    """
    import torch

    weights, notes = read_map(path)
    network = map_networks().get(notes.get("network", ""))
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
    """Load weights into a network; raises WeightsFileError unless they match its layers and are finite."""
    import torch

    if not all(np.isfinite(value).all() for value in weights.values()):
        raise WeightsFileError(f"{path} has weights that are not finite: train it again at a lower --rate")
    try:
        model.load_state_dict({name: torch.from_numpy(np.array(value)) for name, value in weights.items()})
    except RuntimeError as cause:
        raise WeightsFileError(f"{path} does not match the layers of its network: train it again") from cause
    model.eval()
