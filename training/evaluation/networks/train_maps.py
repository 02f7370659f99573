# SPDX-License-Identifier: GPL-3.0-or-later
"""Training of map networks on rendered frames: checkpoints, a log of the loss, weights (methods 3.9-3.11).

The module of each network lists its differences from its paper. All random numbers follow from the seed and the number
of the step, so that a resumed run continues exactly with one thread of torch, and up to the order of partial sums with
several.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from ....patchnet_addon.network.devices import enough_memory, found_device
from ....patchnet_addon.runtime.errors import PatchNetError
from ....patchnet_addon.runtime.progress import Progress, Steps
from ....patchnet_addon.sampling.pixel_buffers import active_pixels
from ...run.learner import Resumable
from ...run.run_files import CHECKPOINT, LOG, check_run
from ...run.run_log import Log
from ...run.trainer import CHECKPOINT_S, RunOptions, load_checkpoint, write_checkpoint
from .frames import MASK, SUBPIXELS, RenderedFrame
from .map_network import MapBatch, MapNetwork
from .maps import MAP, RUN_FILES, map_networks, save_map

_NETWORKS = map_networks()


def batch_of_crops(
    frames: Sequence[RenderedFrame], network: MapNetwork, *, batch: int, crop: int, seed: int, step: int
) -> MapBatch:
    """Draw `batch` crops of at most crop x crop pixels around active pixels of uniformly drawn frames.

    Frames are of one size. Inactive pixels, far from any surface, are never refined and not used as centers.
    """
    rng = np.random.default_rng([seed, step])
    planes, pictures, fine = [], [], []
    for number in rng.integers(len(frames), size=batch):
        frame = frames[number]
        rows, columns = _corner(frame.planes[MASK] > 0, crop, rng)
        planes.append(network.planes(frame.planes[:, rows, columns]))
        pictures.append(frame.pictures[:, rows, columns])
        fine.append(frame.fine[_parts(rows), _parts(columns)])
    return MapBatch(*(torch.from_numpy(np.stack(values)) for values in (planes, pictures, fine)))


def _corner(hit: np.ndarray, crop: int, rng: np.random.Generator) -> tuple[slice, slice]:
    """Rows and columns of a crop centered at an active pixel, within the picture."""
    active = np.flatnonzero(active_pixels(hit))
    middle = rng.choice(active) if len(active) else rng.integers(hit.size)
    found = []
    for at, size in zip(divmod(int(middle), hit.shape[1]), hit.shape, strict=True):
        first = min(max(at - crop // 2, 0), max(size - crop, 0))
        found.append(slice(first, min(first + crop, size)))
    return found[0], found[1]


def _parts(pixels: slice) -> slice:
    return slice(SUBPIXELS * pixels.start, SUBPIXELS * pixels.stop)


@dataclass(frozen=True)
class MapSettings:
    """Settings that determine the result of a training run.

    network: its name. steps: of Adam. batch, crop: crops per step, and side of a crop in pixels; 0 for the network's
    defaults. rate: learning rate, by default the papers'.
    """

    network: str
    steps: int
    batch: int = 0
    crop: int = 0
    rate: float = 1e-4
    seed: int = 0


class MapLearner(Resumable):
    """Network and optimiser of a run on one device."""

    def __init__(self, settings: MapSettings, device: str) -> None:
        self.network: MapNetwork = _NETWORKS[settings.network]
        self.device = torch.device(device)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(settings.seed)
            self.model = self.network.build()
        self.model.to(self.device)
        self.optimizer = torch.optim.Adam(self.model.parameters(), settings.rate)
        super().__init__(model=self.model, optimizer=self.optimizer)

    def step(self, batch: MapBatch) -> torch.Tensor:
        """Take one step; returns the loss of the batch before it, without synchronization."""
        there = MapBatch(*(values.to(self.device) for values in (batch.planes, batch.pictures, batch.fine)))
        loss = self.network.loss(self.model, there)
        self.optimizer.zero_grad()
        loss.backward()
        self.optimizer.step()
        self.steps += 1
        return loss.detach()


def train_maps(frames: Sequence[RenderedFrame], key: str, settings: MapSettings, options: RunOptions) -> Steps[Path]:
    """Train a map network on frames of one size, and return the path of its weights.

    key: of the frames, so that a run is not resumed on others. Updates `checkpoint.pt`, `sampling_map.safetensors` and
    `log.jsonl` in `options.out`. Raises PatchNetError if the loss is not finite, and as
    `check_run` and `load_checkpoint`.
    """
    check_run(options.out, resume=options.resume, kinds=RUN_FILES)
    options.out.mkdir(parents=True, exist_ok=True)
    with enough_memory("training"):
        learner = MapLearner(settings, found_device(options.device))
    run = asdict(settings) | {"frames": key}
    del run["steps"]  # the rate is constant, so that a run can be extended
    if options.resume:
        load_checkpoint(options.out / CHECKPOINT, learner, run)
    log = Log(options.out / LOG, learner.steps)
    end = min(settings.steps, options.stop_after or settings.steps)
    batch, crop = settings.batch or learner.network.batch, settings.crop or learner.network.crop
    before, saved = time.monotonic() - learner.seconds, time.monotonic()
    while learner.steps < end:
        crops = batch_of_crops(frames, learner.network, batch=batch, crop=crop, seed=settings.seed, step=learner.steps)
        with enough_memory("batches of this size (--batch)"):
            log.add(learner.step(crops))
        learner.seconds = time.monotonic() - before
        if learner.steps % options.log_steps == 0 or learner.steps == end:
            (mean,) = log.means()
            if mean != mean:
                raise PatchNetError(
                    f"The loss is not finite after {learner.steps} steps: train again with a lower --rate"
                )
            log.write({"step": learner.steps, "loss": round(mean, 8), "seconds": round(learner.seconds, 1)})
        if time.monotonic() - saved > CHECKPOINT_S:
            _save(learner, run, options, len(frames))
            saved = time.monotonic()
        yield Progress(learner.steps, end, "Training")
    return _save(learner, run, options, len(frames))


def _save(learner: MapLearner, run: dict[str, Any], options: RunOptions, frames: int) -> Path:
    """Write checkpoint and weights, each atomically."""
    write_checkpoint(options.out, run, learner.state())
    weights = {name: value.cpu().numpy() for name, value in learner.model.state_dict().items()}
    extent = {"steps": learner.steps, "frames": frames, "minutes": round(learner.seconds / 60, 1)}
    save_map(options.out / MAP, learner.network.name, weights, options.notes | extent)
    return options.out / MAP
