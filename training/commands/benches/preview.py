# SPDX-License-Identifier: GPL-3.0-or-later
"""Processor seconds until the first lit picture and until the last one, against Cycles' denoised still of the view.

Both read the scene. The job is that of Preview Selection with its defaults and no kept light, after a small one that
reads all kernels.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from pathlib import Path
from typing import Any
from unittest.mock import patch

import bpy

from ....commands.shared.progress_lines import progress_lines
from ....commands.shared.quiet import quiet_stdout
from ....commands.shared.scene_argument import open_or_build
from ....operators.cycles.scene_copy import prepared
from ....operators.pipeline.run import JobResult, run_job
from ....operators.settings.job_settings import JobSettings
from ....patchnet_addon.runtime.progress import Steps, drain
from ....patchnet_addon.tracing.camera import Camera
from ...benchmarks.timing import comparison
from .walk_renders import denoise

_SMALL = (32, 32)


def measure(args: argparse.Namespace) -> dict[str, Any]:
    """Seconds of both; raises PatchNetError."""
    settings = JobSettings.of(cameras=(args.camera,), size=tuple(args.size))
    show = progress_lines()
    with quiet_stdout():
        open_or_build(args.scene)
        drain(run_job(bpy.context, settings.changed(size=_SMALL, max_samples=2)), show)
        first: list[tuple[float, JobResult]] = []

        def early(made: JobResult) -> Steps[None]:
            first.append((time.process_time(), made))
            yield from ()

        with tempfile.TemporaryDirectory(prefix="patchnet-") as folder, patch.dict(os.environ, PATCHNET_CACHE=folder):
            start = time.process_time()  # kernels are read, light is not kept
            steps = run_job(bpy.context, settings, early=early)
            whole = drain(steps, show)
            end = time.process_time()
        camera = whole.views[0].camera
        still = _still(camera, args.cycles_samples)
    light = whole.report["light"]
    shown, lit = first[0] if first else (end, whole)
    details = {
        "scene": Path(args.scene).name,
        "camera": camera.name,
        "size": list(args.size),
        "whole_s": end - start,
        "noise": {"first": lit.report["light"]["light_noise"], "last": light["light_noise"]},
        "paths_per_pixel": light["light_paths"] / (args.size[0] * args.size[1]),
        "cycles_samples": args.cycles_samples,
        "voxels": whole.coded.octree.leaf_count,
        "clock": "processor",
    }
    return comparison("preview", shown - start, still, details, "seconds until a lit picture", higher_is_better=False)


def _still(camera: Camera, samples: int) -> float:
    """Seconds of Cycles' picture, denoised where the build of Blender can."""
    with prepared(bpy.context, camera, samples, 0, Path()) as (scene, _):
        denoise(scene)
        start = time.process_time()
        bpy.ops.render.render(scene=scene.name)
        return time.process_time() - start
