# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames of a camera track, evaluated in blocks of one file each, so that a stopped evaluation can continue."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from ...patchnet_addon.codes.predict import predict
from ...patchnet_addon.runtime.files import write_arrays
from ...patchnet_addon.runtime.progress import drain
from ...patchnet_addon.runtime.threads import limit_threads
from ...patchnet_addon.sampling.errors import squared_error
from ...patchnet_addon.sampling.predicted import PREDICTED, PREVIEW
from ...patchnet_addon.sampling.trace import trace_view
from ...patchnet_addon.sampling.uniform import SIDES, uniform_error
from ...patchnet_addon.tracing.camera import Camera
from . import kept_arrays
from .codes import EvaluationSettings, SceneCodes, scene_codes
from .curves import frame_errors, frame_orders
from .picture_metrics import quality_of
from .strategies import strategies_in_use

KIND = "frames"


@dataclass(frozen=True, eq=False)
class FrameBlock:
    """Block of F frames of a scene, the unit of work and storage.

    folder: of the scene's codes and results. key: hash of all dependencies; a file with another key is computed again.
    """

    octree: Path
    folder: Path
    settings: EvaluationSettings
    cameras: Sequence[Camera]
    first: int
    key: str

    @property
    def path(self) -> Path:
        """File of the results."""
        return self.folder / "frames" / f"{self.first:05}.safetensors"


@dataclass(frozen=True, eq=False)
class BlockResult:
    """Results of F frames, S strategies and U uniform pictures, which have SIDES.

    active, left: as in `TrackErrors`. hits, ahead: (F,) int64, pixels whose ray met a voxel, and those of
    them with look-ahead. uniform: (F, U) float64, squared error of pictures with side x side rays in each pixel, summed
    over active pixels. predicted: (F, N) float64, the same of N predicted pictures. quality: (F, Q, M) float64, see
    `quality_of`.
    """

    active: np.ndarray
    left: np.ndarray
    hits: np.ndarray
    ahead: np.ndarray
    uniform: np.ndarray
    predicted: np.ndarray
    quality: np.ndarray

    @classmethod
    def joined(cls, blocks: Sequence[BlockResult]) -> BlockResult:
        """Join the frames of blocks."""
        names = cls.__dataclass_fields__
        return cls(*(np.concatenate([getattr(block, name) for block in blocks]) for name in names))


def evaluate_block(block: FrameBlock) -> None:
    """Evaluate the frames of a block on one thread and write them."""
    codes = _load(block.octree, block.folder, block.settings)
    coded = codes.coded
    strategies = strategies_in_use(block.settings.maps, block.settings.networks)
    frames = []
    with limit_threads(1):
        for camera in block.cameras:
            wanted = list(strategies.values())
            traced = drain(trace_view(coded.octree, camera, wanted, coded=coded, unrefined=PREDICTED))
            buffers = replace(traced, unrefined=PREVIEW)  # as in the paper
            # Each further network decodes once, at the same hits.
            others = {
                each: replace(buffers, prediction=predict(each, buffers.hits)) for each in codes.networks.values()
            }
            views = {coded: buffers} | others
            scores = {name: each.scores(views[codes.of(each)]) for name, each in strategies.items()}
            orders = frame_orders(buffers, scores)
            prediction = buffers.prediction
            assert prediction is not None  # traced for the predicted picture
            predicted = [squared_error(replace(view, unrefined=PREDICTED)) for view in views.values()]
            frames.append(
                {
                    "active": buffers.active.sum(),
                    "left": frame_errors(buffers, orders),
                    "hits": buffers.hit.sum(),
                    "ahead": np.count_nonzero(prediction.look_ahead & buffers.hit),
                    "uniform": [drain(uniform_error(coded.octree, camera, buffers, side)) for side in SIDES],
                    "predicted": [error[buffers.active].sum() for error in predicted],
                    "quality": quality_of(buffers, orders),
                }
            )
    arrays = {name: np.array([frame[name] for frame in frames]) for name in BlockResult.__dataclass_fields__}
    block.path.parent.mkdir(parents=True, exist_ok=True)
    write_arrays(block.path, arrays, {"key": block.key, "first": block.first}, KIND)


def load_block(block: FrameBlock) -> BlockResult | None:
    """Results of a block from its file, see `kept_arrays`."""
    arrays = kept_arrays(block.path, KIND, block.key)
    return None if arrays is None else BlockResult(**arrays)


@lru_cache(maxsize=1)
def _load(octree: Path, folder: Path, settings: EvaluationSettings) -> SceneCodes:
    """Scene of the last block; its codes are mapped, so that processes share memory."""
    return drain(scene_codes(octree, folder, settings))
