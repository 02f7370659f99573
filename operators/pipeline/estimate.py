# SPDX-License-Identifier: GPL-3.0-or-later
"""Estimate of a job from a coarse octree, the pixels of the cameras and the sizes of triangles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import bpy

from ...patchnet_addon.octree.grid import Grid
from ...patchnet_addon.runtime.bounds import MAX_DEPTH
from ...patchnet_addon.runtime.progress import Progress, Steps, labelled
from ...patchnet_addon.runtime.quantities import bytes_text, count_text, counted
from ...patchnet_addon.runtime.worker import run_in_worker
from ...patchnet_addon.tracing.camera import Camera
from ..cycles.bake.gloss_passes import gloss_warnings, with_view
from ..scene.cameras import focus_warnings, looking_cameras
from ..scene.read import read_scene
from ..scene.scene_mesh import SceneMesh
from ..scene_access.devices import device_text
from ..scene_access.lengths import length_text
from ..settings.job_settings import JobSettings
from .job_work import Rates, texels_of, time_line, work_of
from .stages import GridChoice, encoder_text, load_network

_BYTES_PER_CODED = 12.2 + 2.2 * 20  # index, and codes shared with neighbours


@dataclass
class Estimate:
    """Expected figures of a job.

    fitted: leaves follow the cameras, so that only memory bounds `leaves` and bytes. peak_bytes: of building;
    free_bytes: limit. lookahead_share: of hit pixels, least of all cameras, None if no camera sees anything. texels,
    paths: of the bake, 0 without one; paths of one side of the surface. seconds: by stage. time_line, made_for, lines:
    time, surface and views, and figures in words. notes: omissions and approximations that are known without a bake.
    settings: of the scene at the estimate. outdated: the scene may have changed since.
    """

    depth: int
    fitted: bool
    leaves: int
    octree_bytes: int
    codes_bytes: int
    peak_bytes: int
    free_bytes: int
    lookahead_share: float | None
    texels: int
    paths: int
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
        return self.peak_bytes > self.free_bytes


def estimate_job(context: bpy.types.Context, settings: JobSettings) -> Steps[Estimate]:
    """Estimate a job from a coarse octree of the scene; raises PatchNetError."""
    yield Progress(0, 1, "Reading the scene")
    light, views, depsgraph = settings.light, settings.view, context.evaluated_depsgraph_get()
    source = read_scene(depsgraph, settings.surface.scope)
    depsgraph, bounds_world = context.evaluated_depsgraph_get(), settings.surface.bounds_world(source)
    cameras = yield from looking_cameras(depsgraph, views.cameras, views.size, bounds_world, source)
    steps = run_in_worker(lambda: _estimate(source, cameras, settings), Progress(0, 1, "Estimating"))
    of_light = source.color_warnings
    if light.is_baked:
        of_light = gloss_warnings(source, with_view(context, light, views.cameras))
    notes = (*focus_warnings(context.scene, cameras), *source.warnings, *of_light)
    found = replace((yield from steps), notes=notes)
    side = settings.surface.voxel_size_world or Grid.around(bounds_world, found.depth).voxel_size_world
    device = device_text(context, settings.compute.device) if light.is_baked else ""
    found.lines = _lines(found, length_text(context.scene, side), device, encoder_text(settings.compute))
    return found


def _estimate(source: SceneMesh, cameras: Sequence[Camera], settings: JobSettings) -> Steps[Estimate]:
    from ...patchnet_addon.lod.depth import available_memory, choose_depth, coarse_octree, estimate, expected_share

    surface, light = settings.surface, settings.light
    bounds, lookahead = surface.bounds_world(source), load_network(settings.network).lookahead
    coarse = yield from labelled(coarse_octree(source, bounds_world=bounds), "Estimating")
    free = settings.compute.memory_bytes or available_memory()
    yield Progress(1, 3, "Estimating: what cameras see")
    automatic = choose_depth(coarse, cameras, None, free, color=light.color, sides=light.has_sides, lookahead=lookahead)
    depth = min(automatic.wanted if surface.fit else automatic.depth, MAX_DEPTH)
    if surface.depth is not None:
        depth = surface.depth
    elif surface.voxel_size_world is not None:
        depth = Grid.with_voxel_size(bounds, surface.voxel_size_world).depth
    leaves, octree_bytes, peak = estimate(coarse, depth, color=light.color, sides=light.has_sides)
    yield Progress(2, 3, "Estimating: texels of the bake")
    texels = 0
    if light.is_baked:
        texels = yield from texels_of(source, GridChoice(Grid.around(bounds, depth)), settings)
    rates = Rates()
    triangles = source.triangle_count
    pixels = sum(camera.pixel_count for camera in cameras)
    work = work_of(settings, pixels=pixels, triangles=triangles, leaves=leaves, texels=texels)
    seconds = rates.seconds(work)
    return Estimate(
        depth=depth,
        fitted=surface.fit,
        leaves=leaves,
        octree_bytes=octree_bytes,
        # Nodes with look-ahead, that many levels above the leaves and further up, are this share of the leaves.
        codes_bytes=int(leaves / (3.0 * 4.0 ** (lookahead - 1)) * _BYTES_PER_CODED),
        peak_bytes=min(peak, free) if surface.fit else peak,
        free_bytes=free,
        lookahead_share=expected_share(coarse, cameras, depth, lookahead=lookahead),
        texels=texels,
        paths=texels * light.samples,
        made_for=_made_for(source, cameras),
        seconds=seconds,
        time_line=time_line(seconds, rates, at_most=surface.fit),
    )


def _made_for(source: SceneMesh, cameras: Sequence[Camera]) -> tuple[str, str]:
    names = {name for part in source.parts for name in part.objects}
    objects = f"'{names.pop()}'" if len(names) == 1 else f"{len(names):,} objects"
    views = f"camera '{cameras[0].name}'" if len(cameras) == 1 else f"{len(cameras)} cameras"
    size = f"{cameras[0].width_px} x {cameras[0].height_px}"
    return f"{objects}, {counted(source.triangle_count, 'triangle')}", f"{views[:1].upper()}{views[1:]} at {size}"


def _lines(found: Estimate, voxel_side: str, device: str, encoder: str) -> list[str]:
    """Estimate in words. voxel_side: with its unit. device, encoder: their names."""
    most = "Up to depth" if found.fitted else "Depth"
    lines = [f"{most} {found.depth}, voxel side {voxel_side}"]
    if found.fitted:
        lines.append("As many voxels as cameras need")
        lines.append(f"Building takes at most {bytes_text(found.free_bytes)}")
    else:
        lines.append(f"About {count_text(found.leaves)} voxels")
        lines.append(f"Building takes {bytes_text(found.peak_bytes)} of {bytes_text(found.free_bytes)}")
        lines.append(f"Octree {bytes_text(found.octree_bytes)}, look-ahead {bytes_text(found.codes_bytes)}")
    share = found.lookahead_share
    lines.append("No camera sees anything" if share is None else f"Look-ahead on {share:.0%} of pixels")
    if found.texels:
        about = "at most" if found.fitted else "about"
        lines.append(f"Bake: {about} {count_text(found.texels)} texels")
        lines.append(f"Samples of light: {count_text(found.paths)}")
        lines.append(f"Bake on: {device}")
    lines.append(f"Network on: {encoder}")
    return [*lines, found.time_line]
