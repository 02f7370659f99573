# SPDX-License-Identifier: GPL-3.0-or-later
"""Steps of `patchnet verify-light`: bake, build, render octree and Cycles, compare (docs/lab/light.md)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...patchnet_addon.image.comparison import Guides, compare, difference_picture, picture_psnr, side_by_side
from ...patchnet_addon.image.cycles_passes import Reference
from ...patchnet_addon.image.heatmap import magnify
from ...patchnet_addon.image.tone import gray
from ...patchnet_addon.lod.placed_cameras import cameras_around
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.process.computed import computed
from ...patchnet_addon.runtime.file_kinds import PNG, REPORT, FileKind
from ...patchnet_addon.runtime.progress import Progress, Steps, labelled
from ...patchnet_addon.runtime.stage_clock import StageClock
from ...patchnet_addon.tracing.camera import Camera
from ..computing.views import mean_and_coverage, reason_unseen
from ..cycles.camera_render import render_halves
from ..pipeline.lit_octree import OctreeOverrides, ReadSurface, choose_leaves, light_octree, read_surface
from ..pipeline.reports import REPORT_NAME, machine, versions, write_report
from ..scene.cameras import camera_size_px, looking_cameras
from ..scene_access.images import save_png
from ..schema.values import GLOSS_OFF
from ..settings.job_settings import JobSettings

_COARSE_DEPTH = 8  # of the voxels among which cameras are placed
_PICTURES = ("cycles.png", "octree.png", "difference.png", "side_by_side.png")


@dataclass(frozen=True)
class CheckSettings:
    """Settings of a light check.

    job: settings of the octree (depth and light), size and cameras; its `out` takes the results.
    viewpoints: number of cameras placed in and around the scene; 0 takes the job's cameras. render_samples:
    paths per pixel of the Cycles reference, in two halves of different seeds. rays: per pixel side, of the octree's
    picture. difference: luminance at the ends of the pictures' legend.
    """

    job: JobSettings
    viewpoints: int = 0
    render_samples: int = 256
    rays: int = 32
    difference: float = 0.2


@dataclass(frozen=True, eq=False)
class CameraCheck:
    """Pictures of one camera (H, W) float32, exposed and clamped to [0, 1], row 0 at the bottom, and figures."""

    camera: Camera
    cycles: np.ndarray
    octree: np.ndarray
    report: dict[str, Any]


@dataclass(frozen=True, eq=False)
class LightCheck:
    """Result of a check: the octree, the pictures of each camera, and the report."""

    octree: Octree
    cameras: tuple[CameraCheck, ...]
    report: dict[str, Any]


def verify_light(context: bpy.types.Context, settings: CheckSettings) -> Steps[LightCheck]:
    """Compare the octree of the open scene with Cycles; the scene is as before afterwards; raises PatchNetError.

    The light is baked for the compared cameras; a restarted check reuses what a stopped one has baked.
    """
    clock, checks, warnings = StageClock(), [], []
    surface = yield from read_surface(context, settings.job, clock, OctreeOverrides())
    cameras = yield from _cameras(context, surface, settings)
    choice = yield from choose_leaves(context, surface, clock, cameras)
    made = yield from light_octree(context, surface, replace(choice, cameras=cameras), clock)
    octree = made.octree
    for camera in cameras:
        with clock.stage("cameras"):
            steps = check_camera(context, octree, camera, settings)
            checks.append((yield from labelled(steps, f"{camera.name}: {{}}")))
        brightest = float(checks[-1].octree.max())
        if unseen := (yield from computed(reason_unseen, octree, camera, brightest)):
            warnings.append(unseen)
    report = _report(octree, checks, settings, clock.seconds, [*made.warnings, *warnings])
    return LightCheck(octree, tuple(checks), report)


def _cameras(context: bpy.types.Context, surface: ReadSurface, settings: CheckSettings) -> Steps[list[Camera]]:
    """Cameras to compare; those that are placed follow coarse voxels."""
    wanted, source = settings.job.view, surface.source
    bounds_world = settings.job.surface.bounds_world(source)
    if settings.viewpoints:
        size_px = camera_size_px(context.scene, wanted.size)
        among = source, bounds_world, _COARSE_DEPTH, settings.viewpoints, size_px
        return (yield from computed(cameras_around, *among, at=Progress(0, 1, "Placing cameras")))
    depsgraph = context.evaluated_depsgraph_get()
    return (yield from looking_cameras(depsgraph, wanted.cameras, wanted.size, bounds_world, source))


def check_camera(
    context: bpy.types.Context, octree: Octree, camera: Camera, settings: CheckSettings
) -> Steps[CameraCheck]:
    """Render octree and Cycles through one camera, and compare."""
    looking = Progress(0, 1, "Super-sampling")
    mine = yield from computed(mean_and_coverage, octree, camera, settings.rays, at=looking)
    halves = yield from render_halves(context, camera, settings.render_samples)
    if settings.job.light.is_baked and settings.job.light.gloss != GLOSS_OFF:  # else diffuse light and emission
        halves = [replace(half, luminance=half.combined) for half in halves]
    exposure = octree.exposure
    report = _figures(mine, halves, exposure) | _noise_and_place(halves, exposure, camera)
    mean = np.mean([half.luminance for half in halves], axis=0)
    cycles = np.clip(exposure * mean, 0.0, 1.0).astype(np.float32)
    return CameraCheck(camera, cycles, mine[0], report)


def _figures(look: tuple[np.ndarray, np.ndarray], halves: Sequence[Reference], exposure: float) -> dict[str, Any]:
    cycles = np.mean([half.luminance * np.float32(exposure) for half in halves], axis=0)
    guides = Guides(halves[0].coverage, look[1], halves[0].depth_world, halves[0].albedo, halves[0].normal)
    return compare(look[0], cycles, guides)


def _noise_and_place(halves: Sequence[Reference], exposure: float, camera: Camera) -> dict[str, Any]:
    """Noise of the mean of two independent halves, which is half their difference, and the camera's position."""
    first, second = (np.clip(half.luminance * np.float32(exposure), 0, 1) / 2 for half in halves)
    return {
        "reference_noise_db": picture_psnr(first + 0.5, second + 0.5),
        "camera": camera.name,
        "size": [camera.width_px, camera.height_px],
        "position_world": [round(float(value), 6) for value in camera.position_world],
        "forward": [round(float(value), 6) for value in camera.forward],
        "fov_degrees": float(np.degrees(2.0 * np.arctan(camera.half_y))),
    }


def _report(
    octree: Octree,
    checks: list[CameraCheck],
    settings: CheckSettings,
    timings_s: dict[str, float],
    warnings: list[str],
) -> dict[str, Any]:
    return {
        "mean": _mean_figures(checks),
        "cameras": [check.report for check in checks],
        "octree": {
            "depth": octree.depth,
            "leaves": octree.leaf_count,
            "voxel_world": octree.grid.voxel_size_world,
            "exposure": octree.exposure,
        },
        "settings": {"render_samples": settings.render_samples, "rays": settings.rays},
        "light": octree.provenance,
        "timings_s": timings_s,
        "warnings": warnings,
        "versions": versions(),
        "machine": machine(),
    }


def _mean_figures(checks: Sequence[CameraCheck]) -> dict[str, Any]:
    """Mean figures of all cameras."""
    mine = sum(float(check.octree.sum(dtype=np.float64)) for check in checks)
    cycles = sum(float(check.cycles.sum(dtype=np.float64)) for check in checks)
    mse = [10.0 ** (-check.report["psnr_db"] / 10.0) for check in checks]
    return {"psnr_db": -10.0 * float(np.log10(np.mean(mse))), "mean_ratio": mine / cycles if cycles else None}


def check_files(folders: Iterable[str]) -> dict[str, FileKind]:
    """Kind of each file of a light check by its path in the output folder; `folders` are those of the cameras."""
    return {REPORT_NAME: REPORT} | {f"{folder}/{name}": PNG for folder in folders for name in _PICTURES}


def save_check(check: LightCheck, folder: Path, maximum: float, folders: Mapping[str, str]) -> None:
    """Write report.json, and pictures into the folder of each camera; folders: by the cameras' names."""
    for item in check.cameras:
        item.report["folder"] = folders[item.camera.name]
        target = folder / folders[item.camera.name]
        target.mkdir()
        _save_camera(item, target, maximum)
    write_report(folder, "light check", check.report)


def _save_camera(item: CameraCheck, folder: Path, maximum: float) -> None:
    ratio = item.report["mean_ratio"]
    figures = f"{item.report['psnr_db']:.1f} dB, mean ratio {'-' if ratio is None else format(ratio, '.3f')}"
    cycles, octree, difference, beside = (folder / name for name in _PICTURES)
    save_png(cycles, magnify(gray(item.cycles)))
    save_png(octree, magnify(gray(item.octree)))
    title, quantity = f"{item.camera.name}: {figures}", "luminance, octree less Cycles"
    save_png(difference, difference_picture(item.octree - item.cycles, maximum, title, quantity))
    titles = "Cycles", "octree", figures
    save_png(beside, side_by_side(item.cycles, item.octree, maximum, titles))
