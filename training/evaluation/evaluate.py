# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluation of strategies on scenes: octrees, codes, camera tracks, frames on all cores, results.

All long computations are stored in the folder of the evaluation with a hash of their dependencies, so that a later run
skips finished parts, also after a kill.
"""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import threading
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.octree.file import octree_hash
from ...patchnet_addon.runtime.progress import Progress, Steps, drain
from ...patchnet_addon.runtime.source_hash import source_hash
from ...patchnet_addon.runtime.threads import usable_cores
from ...patchnet_addon.sampling.strategy import Strategy
from ...patchnet_addon.sampling.uniform import SIDES
from ..encoders import load_weights
from .codes import EvaluationSettings, scene_codes
from .costs import Costs, measure_costs, read_costs, write_costs
from .frames import BlockResult, FrameBlock, evaluate_block, load_block
from .networks.maps import map_hash
from .strategies import strategies_in_use
from .tracks import camera_track

_BLOCK = 8  # frames
_COST_FRAMES, _COST_REPEATS = 5, 3
_LABEL = "Evaluating"


@dataclass(frozen=True, eq=False)
class SceneResult:
    """Results of a scene: strategies by name in the order of results, frames, costs, octree with its codes."""

    name: str
    strategies: Mapping[str, Strategy]
    frames: BlockResult
    costs: Costs
    coded: CodedOctree


def evaluate(octrees: Mapping[str, Path], settings: EvaluationSettings, out: Path) -> Steps[list[SceneResult]]:
    """Evaluate all strategies on octree files by name of the scene; existing parts in `out` are skipped."""
    strategies = strategies_in_use(settings.maps, settings.networks)
    scenes = yield from prepare(octrees, settings, out)
    yield from _run([block for blocks in scenes.values() for block in blocks], settings.processes or usable_cores())
    results = []
    for number, (name, blocks) in enumerate(scenes.items()):
        yield Progress(number, len(scenes), "Measuring costs")
        results.append(_result(name, blocks, strategies))
    return results


def prepare(octrees: Mapping[str, Path], settings: EvaluationSettings, out: Path) -> Steps[dict[str, list[FrameBlock]]]:
    """Encode octrees and create their tracks; blocks of frames by scene."""
    weights = load_weights(settings.weights)
    scenes = {}
    for name, path in octrees.items():
        folder = out / "scenes" / name
        octree = (yield from scene_codes(path, folder, settings)).coded.octree
        cameras = (yield from camera_track(octree, settings.track, weights.lookahead))[:: settings.track.every]
        key = _key(settings, octree_hash(octree), weights.whole_hash)
        scenes[name] = [
            FrameBlock(path, folder, settings, cameras[first : first + _BLOCK], first, key)
            for first in range(0, len(cameras), _BLOCK)
        ]
    return scenes


def _key(settings: EvaluationSettings, octree: str, weights: str) -> str:
    """Hash of the dependencies of a frame's errors: settings, files, and code."""
    code = source_hash("training.evaluation.frames", "training.evaluation.tracks")
    maps = [map_hash(path) for path in settings.maps]
    networks = [(network.name, network.hash) for network in settings.networks]  # costs are stored by name
    what = repr((settings.track, octree, weights, maps, networks, SIDES, code))
    return hashlib.sha256(what.encode()).hexdigest()[:32]


def _run(blocks: Sequence[FrameBlock], processes: int) -> Steps[None]:
    """Evaluate blocks in processes of one thread each."""
    left = [block for block in blocks if load_block(block) is None]
    done = len(blocks) - len(left)
    yield Progress(done, len(blocks), _LABEL)
    if not left:
        return
    # Not forked: threads and libraries of this process do not survive a fork.
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(processes, len(left)), spawn, initializer=_end_with_parent) as pool:
        try:
            for number, task in enumerate(as_completed([pool.submit(evaluate_block, each) for each in left]), done + 1):
                task.result()
                yield Progress(number, len(blocks), _LABEL)
        finally:  # after an error or a stop, blocks that have not begun are left to a later run
            pool.shutdown(cancel_futures=True)


def _end_with_parent() -> None:
    """Let this process end with the one that started it, which Ctrl-C and SIGTERM end at once."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def wait() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


def _result(name: str, blocks: Sequence[FrameBlock], strategies: Mapping[str, Strategy]) -> SceneResult:
    found = [block for block in map(load_block, blocks) if block is not None]
    codes = drain(scene_codes(blocks[0].octree, blocks[0].folder, blocks[0].settings))
    path, key = blocks[0].folder / "costs.json", blocks[0].key
    costs = read_costs(path, key)
    if costs is None:  # measured on frames all over the track
        cameras = [camera for block in blocks for camera in block.cameras]
        step = max(len(cameras) // _COST_FRAMES, 1)
        costs = measure_costs(codes, cameras[::step][:_COST_FRAMES], strategies, _COST_REPEATS)
        write_costs(costs, path, key)
    return SceneResult(name, strategies, BlockResult.joined(found), costs, codes.coded)
