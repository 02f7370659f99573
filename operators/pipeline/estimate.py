# SPDX-License-Identifier: GPL-3.0-or-later
"""Estimate of a job from a coarse octree, the pixels of the cameras and the sizes of triangles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import bpy

from ...patchnet_addon.octree.grid import Grid
from ...patchnet_addon.process.computed import computed
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.runtime.quantities import bytes_text, count_text, counted
from ...patchnet_addon.surface.scene_mesh import SceneMesh
from ...patchnet_addon.tracing.camera import Camera
from ..computing.grids import Expected, expected_octree
from ..cycles.bake.gloss_passes import gloss_warnings, with_view
from ..scene.cameras import focus_warnings, looking_cameras
from ..scene.read import read_scene
from ..scene_access.devices import device_text
from ..scene_access.lengths import length_text
from ..settings.job_settings import JobSettings
from .job_work import Rates, layers_of, light_paths, time_line, work_of
from .lit_octree import fit_cameras
from .stages import encoder_text

_BYTES_PER_CODED = 12.2 + 2.2 * 20  # index, and codes shared with neighbours


@dataclass
class Estimate:
    """Expected figures of a job.

    fitted: leaves follow the cameras, most are coarser than the octree's depth. layers: see `layers_of`. paths: of the
    bake, 0 without one. seconds: by stage. time_line, made_for, lines: time, surface and views, and figures in
    words. notes: omissions and approximations that are known without a bake. settings: of the scene at the
    estimate. outdated: the scene may have changed since.
    """

    expected: Expected
    fitted: bool
    layers: float
    codes_bytes: int
    paths: float
    made_for: tuple[str, str]
    seconds: dict[str, float]
    time_line: str
    settings: dict[str, Any] = field(default_factory=dict)
    outdated: bool = False
    lines: list[str] = field(default_factory=list)
    notes: tuple[str, ...] = ()

    @property
    def too_large(self) -> bool:
        """Return whether building would not fit into memory."""
        return self.expected.peak_bytes > self.expected.free_bytes


def estimate_job(context: bpy.types.Context, settings: JobSettings) -> Steps[Estimate]:
    """Estimate a job from a coarse octree of the scene; raises PatchNetError."""
    yield Progress(0, 1, "Reading the scene")
    light, views, depsgraph = settings.light, settings.view, context.evaluated_depsgraph_get()
    source = read_scene(depsgraph, settings.surface.scope)
    depsgraph, bounds_world = context.evaluated_depsgraph_get(), settings.surface.bounds_world(source)
    cameras = yield from looking_cameras(depsgraph, views.cameras, views.size, bounds_world, source)
    fit = (yield from fit_cameras(context, settings, source)) if settings.surface.track else cameras
    steps = computed(expected_octree, source, tuple(cameras), tuple(fit), settings, at=Progress(0, 1, "Estimating"))
    of_light = source.color_warnings
    if light.is_baked:
        of_light = gloss_warnings(source, with_view(context.scene, light, views.cameras, track=settings.surface.track))
    notes = (*focus_warnings(context.scene, cameras), *source.warnings, *of_light)
    found = replace(_estimate(settings, (yield from steps), source, cameras, fit), notes=notes)
    side = settings.surface.voxel_size_world or Grid.around(bounds_world, found.expected.grid.depth).voxel_size_world
    device = device_text(context, settings.light.device) if light.is_baked else ""
    found.lines = _lines(found, length_text(context.scene, side), device, encoder_text(settings.network))
    return found


def _estimate(
    settings: JobSettings, expected: Expected, source: SceneMesh, cameras: Sequence[Camera], fit: Sequence[Camera]
) -> Estimate:
    """Estimate of an expected octree's job; fit: cameras that leaves and light are fitted to."""
    light, leaves, rates = settings.light, expected.leaves, Rates()
    pixels = sum(camera.pixel_count for camera in cameras)
    layers = layers_of(expected.fragments, expected.rough_leaves)
    work = work_of(settings, pixels=pixels, triangles=source.triangle_count, leaves=layers * leaves, cameras=fit)
    seconds = rates.seconds(work)
    return Estimate(
        expected=expected,
        fitted=settings.surface.is_fitted,
        layers=layers,
        # Nodes with look-ahead, that many levels above the leaves and further up, are this share of the leaves.
        codes_bytes=int(leaves / (3.0 * 4.0 ** (expected.lookahead - 1)) * _BYTES_PER_CODED),
        paths=light_paths(settings, fit, leaves=leaves) if light.is_baked else 0.0,
        made_for=_made_for(source, cameras, fit),
        seconds=seconds,
        time_line=time_line(seconds, rates),
    )


def _made_for(source: SceneMesh, cameras: Sequence[Camera], fit: Sequence[Camera]) -> tuple[str, str]:
    names = {name for part in source.parts for name in part.objects}
    objects = f"'{names.pop()}'" if len(names) == 1 else f"{len(names):,} objects"
    views = f"camera '{cameras[0].name}'" if len(cameras) == 1 else f"{len(cameras)} cameras"
    if fit is not cameras:
        views = f"{counted(len(fit), 'view')} of a track"
    size = f"{cameras[0].width_px} x {cameras[0].height_px}"
    return f"{objects}, {counted(source.triangle_count, 'triangle')}", f"{views[:1].upper()}{views[1:]} at {size}"


def _lines(found: Estimate, voxel_side: str, device: str, encoder: str) -> list[str]:
    """Estimate in words. voxel_side: with its unit. device, encoder: their names."""
    expected, share = found.expected, found.expected.lookahead_share
    most = "Up to depth" if found.fitted else "Depth"
    lines = [f"{most} {expected.grid.depth}, voxel side {voxel_side}"]
    lines.append(f"About {count_text(expected.leaves)} voxels")
    lines.append(f"Building takes {bytes_text(expected.peak_bytes)} of {bytes_text(expected.free_bytes)}")
    lines.append(f"Octree {bytes_text(expected.octree_bytes)}, look-ahead {bytes_text(found.codes_bytes)}")
    lines.append("No camera sees anything" if share is None else f"Look-ahead on {share:.0%} of pixels")
    if found.paths:
        lines.append(f"Bake: about {count_text(found.paths)} paths")
        lines.append(f"Bake on: {device}")
    lines.append(f"Network on: {encoder}")
    return [*lines, found.time_line]
