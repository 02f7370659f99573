# SPDX-License-Identifier: GPL-3.0-or-later
"""Camera fly-through of a static scene by the engine PatchNet and by Cycles: seconds, errors, flicker, break-even."""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import fmean, median

import bpy
import numpy as np

from ....operators.cycles.scene_copy import looking_through
from ....operators.pipeline.lit_octree import OctreeOverrides, build_lit_octree
from ....operators.scene_access.overrides import changed
from ....operators.scene_access.temporary import scene_copy
from ....operators.schema.values import VISIBLE
from ....operators.session import results
from ....operators.session.keep import keep
from ....operators.session.scene_result import SceneResult
from ....operators.settings.job_settings import JobSettings
from ....patchnet_addon.image.cycles_passes import combined_light
from ....patchnet_addon.image.exr import read_exr
from ....patchnet_addon.runtime.progress import Progress, Steps
from ....patchnet_addon.runtime.stage_clock import StageClock
from ....patchnet_addon.surface.textures import luminance
from ....patchnet_addon.tracing.camera import Camera

ENGINE = "PATCHNET"
_TRUTH_SEED = 1


@dataclass
class Measured:
    """Figures of one renderer: wall seconds of timed frames; squared error, flicker and moved error of judged frames.

    flicker: mean squared difference to the next frame, less that of the ground truth, which blur lessens. moved: mean
    squared difference between both differences to the next frame, which it does not.
    """

    seconds: list[float] = field(default_factory=list)
    mse: list[float] = field(default_factory=list)
    flicker: list[float] = field(default_factory=list)
    moved: list[float] = field(default_factory=list)

    @property
    def frame_s(self) -> float:
        """Median seconds of a frame."""
        return median(self.seconds)

    @property
    def mean_mse(self) -> float:
        """Mean of the squared errors."""
        return fmean(self.mse)


@dataclass
class Walk:
    """Results of a fly-through: wall seconds of one-time stages, figures of PatchNet, and of Cycles by samples.

    denoised: whether Cycles denoises, which depends on the build. leaves, depth: of the octree.
    """

    setup_s: dict[str, float] = field(default_factory=dict)
    ours: Measured = field(default_factory=Measured)
    cycles: dict[int, Measured] = field(default_factory=dict)
    denoised: bool = False
    depth: int = 0
    leaves: int = 0


def walk(
    context: bpy.types.Context, settings: JobSettings, cameras: Sequence[Camera], args: argparse.Namespace
) -> Steps[Walk]:
    """Bake and build for the cameras of all frames, then render frames with both engines; raises PatchNetError.

    args: of `patchnet bench walkthrough`. Both render through Blender as F12 does, including scene reading. The
    extension has to be registered.
    """
    found = Walk()
    with scene_copy(context.scene) as scene, context.temp_override(scene=scene, view_layer=scene.view_layers[0]):
        yield from _set_up(bpy.context, settings, cameras, found)
        found.denoised = _prepare(scene)
        yield from _timed(scene, cameras, args, found)
        with tempfile.TemporaryDirectory(prefix="patchnet-") as folder:
            yield from _judged(scene, cameras, args, found, Path(folder))
    return found


def _spread(frames: int, count: int) -> list[int]:
    """Frames in the middles of `count` equal parts of the fly-through."""
    count = min(count, frames)
    return [int((index + 0.5) * frames / count) for index in range(count)]


def _set_up(context: bpy.types.Context, settings: JobSettings, cameras: Sequence[Camera], found: Walk) -> Steps[None]:
    """Build the octree and store it as the scene's result."""
    clock = StageClock()
    made = yield from build_lit_octree(context, settings, clock, OctreeOverrides(cameras=lambda: list(cameras)))
    found.setup_s, found.depth, found.leaves = clock.seconds, made.octree.depth, made.octree.leaf_count
    result = SceneResult(
        octree=made.octree, scope=VISIBLE, layout=made.layout, light=made.light, coded=None, state=made.state
    )
    keep(context.scene, result, "octree", "light")


def _prepare(scene: bpy.types.Scene) -> bool:
    """Set render settings of both engines; returns whether Cycles denoises."""
    render, cycles = scene.render, scene.cycles
    render.resolution_percentage, render.film_transparent = 100, True
    render.use_compositing = render.use_sequencer = render.use_border = render.use_multiview = False
    image = render.image_settings
    if hasattr(image, "media_type"):
        image.media_type = "MULTI_LAYER_IMAGE"
    image.file_format, image.color_depth, image.exr_codec = "OPEN_EXR_MULTILAYER", "32", "NONE"
    scene.timeline_markers.clear()
    cycles.use_adaptive_sampling = False
    return denoise(scene)


def denoise(scene: bpy.types.Scene) -> bool:
    """Let Cycles denoise, if the build of Blender can; returns whether it does."""
    cycles = scene.cycles
    try:
        import _cycles  # type: ignore[import-not-found]
    except ImportError:
        _cycles = None
    cycles.use_denoising = bool(getattr(_cycles, "with_openimagedenoise", False))
    if cycles.use_denoising:
        cycles.denoiser = "OPENIMAGEDENOISE"
    return bool(cycles.use_denoising)


def _timed(scene: bpy.types.Scene, cameras: Sequence[Camera], args: argparse.Namespace, found: Walk) -> Steps[None]:
    """Time frames; an untimed frame of PatchNet comes first, for one-time reading."""
    found.cycles = {samples: Measured() for samples in sorted(set(args.cycles_samples))}
    work = [(ENGINE, 0, frame, found.ours) for frame in _spread(len(cameras), args.timed)]
    for samples, measured in found.cycles.items():
        work += [("CYCLES", samples, frame, measured) for frame in _spread(len(cameras), args.cycles_timed)]
    for at, (engine, samples, frame, measured) in enumerate([(*work[0][:3], Measured()), *work]):
        yield Progress(at, len(work) + 1, f"Rendering with {engine}")
        camera = cameras[frame]
        scene.render.resolution_x, scene.render.resolution_y = camera.width_px, camera.height_px
        scene.cycles.samples = samples or scene.cycles.samples
        with looking_through(scene, camera):
            start = time.perf_counter()
            _render(scene, engine)
            measured.seconds.append(time.perf_counter() - start)


def _judged(
    scene: bpy.types.Scene, track: Sequence[Camera], args: argparse.Namespace, found: Walk, folder: Path
) -> Steps[None]:
    """Errors and flicker against the ground truth, of luminance in the octree's exposure, clipped to [0, 1]."""
    exposure = results.voxels_of(scene).octree.exposure
    scene.render.resolution_x, scene.render.resolution_y = args.error_size
    ways = {0: found.ours, **found.cycles}  # by Cycles' samples; 0 is PatchNet
    judged = _spread(max(len(track) - 1, 1), args.judged)  # each with the next frame
    count = len(ways) + 1
    for at, frame in enumerate(judged):
        cameras = track[frame : frame + 2]

        def pair(samples: int, cameras: Sequence[Camera] = cameras, **how: object) -> list[np.ndarray]:
            seen = []
            with changed(scene.cycles, samples=samples or scene.cycles.samples, **how):
                for camera in cameras:
                    with looking_through(scene, camera):
                        picture = _seen(scene, "CYCLES" if samples else ENGINE, folder / "frame.exr")
                    seen.append(np.clip(exposure * picture, 0.0, 1.0))
            return seen

        yield Progress(at * count, len(judged) * count, "Rendering the truth")
        known = pair(args.truth, use_denoising=False, seed=scene.cycles.seed + _TRUTH_SEED)
        for number, (samples, measured) in enumerate(ways.items(), 1):
            yield Progress(at * count + number, len(judged) * count, "Measuring errors")
            seen = pair(samples)
            measured.mse.append(float(np.mean((seen[0] - known[0]) ** 2)))
            if len(seen) == 2:
                moved, moves = (second - first for first, second in (seen, known))
                measured.flicker.append(float(np.mean(moved**2) - np.mean(moves**2)))
                measured.moved.append(float(np.mean((moved - moves) ** 2)))


def _seen(scene: bpy.types.Scene, engine: str, path: Path) -> np.ndarray:
    """Linear luminance (H, W) of a render, over black."""
    scene.render.filepath, scene.render.use_file_extension = str(path), False
    _render(scene, engine, write_still=True)
    return luminance(combined_light(read_exr(path)))


def _render(scene: bpy.types.Scene, engine: str, **how: bool) -> None:
    scene.render.engine = engine
    bpy.ops.render.render(scene=scene.name, **how)
