# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors and seconds of a fly-through's frames by rays in every pixel and the voxels that they meet.

    python docs/pictures/make_frame_samples.py demo [WIDTH HEIGHT]

prints a table over refinement by priority with its default budget, of voxels with one luminance each. The scene is one
of the project's own, of the catalogue (in PATCHNET_SCENES), or a file. Needs the extras `blender` and `bench`.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from statistics import median

import bpy  # noqa: TID251
import numpy as np

from patchnet.__main__ import leave
from patchnet.commands.shared.quiet import quiet_stdout
from patchnet.operators.cycles.camera_render import render_reference
from patchnet.operators.cycles.daylight import daylight, has_light
from patchnet.operators.pipeline.lit_octree import OctreeOverrides, build_lit_octree
from patchnet.operators.pipeline.stages import encode
from patchnet.operators.settings.job_settings import JobSettings
from patchnet.patchnet_addon.codes.coded_octree import CodedOctree
from patchnet.patchnet_addon.network.weights import load_weights
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.runtime.stage_clock import StageClock
from patchnet.patchnet_addon.sampling.adaptive import AdaptivePicture
from patchnet.patchnet_addon.sampling.registry import DEFAULT, STRATEGIES
from patchnet.patchnet_addon.surface.textures import luminance
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.patchnet_addon.tracing.supersample import supersample_pixels
from patchnet.training.benchmarks import markdown_table
from patchnet.training.commands.benches.walkthrough import fly_through_keys, open_scene_of, walk_cameras

FRAMES, MEASURED = 250, (25, 125, 225)
ERROR_SIZE, TRUTH = (240, 135), 256
SIDES, FOOTPRINTS = (2, 3, 4, 8), (4, 8, 16, 32)
BY_PRIORITY, ONE = "by priority", "by priority, one luminance a voxel"


def main() -> None:
    """Measure a scene and print its table."""
    scene, width, height = (*sys.argv[1:], *("demo", "480", "270")[len(sys.argv) - 1 :])
    size = int(width), int(height)
    open_scene_of(scene)
    lit = has_light(bpy.context.evaluated_depsgraph_get())
    with nullcontext() if lit else daylight(bpy.context.scene), quiet_stdout():
        cameras = walk_cameras(fly_through_keys(size), FRAMES, size)
        coded = _coded(cameras)
        truths = {frame: _truth(coded, cameras[frame].with_size(*ERROR_SIZE)) for frame in MEASURED}
    one = replace(coded, octree=coded.octree.without_sides())
    ways: dict[str, Callable[[Camera], np.ndarray]] = {
        ONE: lambda camera: _by_priority(one, camera),
        BY_PRIORITY: lambda camera: _by_priority(coded, camera),
    }
    for side in SIDES:
        for finer in (each for each in FOOTPRINTS if each >= side):
            ways[f"{side} x {side}, voxels of 1/{finer}"] = lambda camera, s=side, f=finer: _even(coded, camera, s, f)
    ways["32 x 32, voxels of 1/32"] = lambda camera: _even(coded, camera, 32, 32)
    rows, first = [], (0.0, 0.0)
    for name, way in ways.items():
        errors = [np.mean((_small(way, cameras[frame]) - truths[frame]) ** 2) for frame in MEASURED]
        error = float(np.mean(errors))
        seconds = median(_seconds(way, cameras[frame]) for frame in MEASURED)
        first = (error, seconds) if name == ONE else first
        ratios = f"{error / first[0]:.2f}", f"{seconds / first[1]:.2f}"
        rows.append([name, f"{1e4 * error:.1f}", f"{seconds:.2f}", *ratios])
    print(markdown_table(["rays", "mse x 10,000", "processor s", "error, ratio", "time, ratio"], rows))
    leave(0)


def _coded(cameras: list[Camera]) -> CodedOctree:
    size = cameras[0].width_px, cameras[0].height_px
    settings = JobSettings.of(color=True, size=size)
    overrides = OctreeOverrides(cameras=lambda: list(cameras))
    octree = drain(build_lit_octree(bpy.context, settings, StageClock(), overrides)).octree
    return drain(encode(octree, load_weights(settings.network.weights), settings.network))[0]


def _truth(coded: CodedOctree, camera: Camera) -> np.ndarray:
    """All light by Cycles, (P,), as the octree shows it."""
    light = render_reference(bpy.context, camera, TRUTH, 7).combined.ravel()
    shown: np.ndarray = np.clip(coded.octree.exposure * light, 0.0, 1.0)
    return shown


def _small(way: Callable[[Camera], np.ndarray], camera: Camera) -> np.ndarray:
    """Luminance (P,) of a frame in the size that errors are measured in."""
    shown: np.ndarray = np.clip(luminance(way(camera.with_size(*ERROR_SIZE))), 0.0, 1.0)
    return shown


def _seconds(way: Callable[[Camera], np.ndarray], camera: Camera) -> float:
    begun = time.process_time()
    way(camera)
    return time.process_time() - begun


def _by_priority(coded: CodedOctree, camera: Camera) -> np.ndarray:
    budget = JobSettings().view.budget
    picture = AdaptivePicture(coded.octree, camera, STRATEGIES[DEFAULT], coded)
    drain(picture.trace())
    drain(picture.refine(budget, refined=JobSettings().view.refined_samples))
    return picture.values[:, :3]


def _even(coded: CodedOctree, camera: Camera, side: int, finer: int) -> np.ndarray:
    picture = AdaptivePicture(coded.octree, camera, None)
    drain(picture.trace())  # as a render of the engine does
    return supersample_pixels(coded.octree, camera, np.arange(camera.pixel_count), side, finer=finer).colors


if __name__ == "__main__":
    main()
