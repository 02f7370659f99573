# SPDX-License-Identifier: GPL-3.0-or-later
"""Main job, from a scene to refined pictures and a report."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.codes.file import save_codes
from ...patchnet_addon.export.fine_light import LIGHT_NOISE, fine_light_values
from ...patchnet_addon.image.unfinished import Meanwhile
from ...patchnet_addon.lod.memory import stored_bytes
from ...patchnet_addon.network.devices import found_device
from ...patchnet_addon.network.weights import Weights, load_weights
from ...patchnet_addon.octree.file import save_octree
from ...patchnet_addon.octree.leaf_levels import LeafLevels
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.process.computed import computed
from ...patchnet_addon.runtime.outputs import check_room
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.sampling.patchnet_plus import estimators_warning
from ...patchnet_addon.sampling.registry import strategy
from ...patchnet_addon.sampling.report import ERROR_UNIT
from ...patchnet_addon.tracing.camera import Camera
from ..computing.cycles_pixels import CyclesView
from ..computing.views import View, overview
from ..scene.cameras import focus_warnings, looking_cameras, octree_cameras
from ..scene.pixel_filter import pixel_filter_of
from ..scene_access.images import VIEW_TRANSFORM, save_png
from ..schema.values import CYCLES, VIEW
from ..settings.groups import NETWORK_DEVICE
from ..settings.job_settings import JobSettings, recorded
from ..state.scene_state import SceneState
from .cycles_pictures import save_cycles
from .cycles_refine import refine_view
from .job_work import JobPlan
from .lit_octree import (
    LitOctree,
    OctreeOverrides,
    ReadSurface,
    choose_leaves,
    fit_cameras,
    light_octree,
    read_surface,
)
from .output_files import CODES_NAME, OCTREE_NAME, OVERVIEW_NAME, job_files, job_inputs, output_folder, view_folders
from .reports import machine, versions, write_report
from .stages import encode
from .unfinished import first_look, stand_in_look
from .views import save_view, view, view_background

EarlyResult = Callable[["JobResult"], Steps[None]]  # takes a result whose light is still being refined


@dataclass(frozen=True, eq=False)
class JobResult:
    """Result of a job.

    notes: sentences about assumptions and omissions, by step. layout: levels of the leaves, None for one level. cycles:
    of each view, with Refine with Cycles. state: of the scene when it was read.
    """

    coded: CodedOctree
    views: tuple[View, ...]
    report: dict[str, Any]
    notes: dict[str, tuple[str, ...]]
    layout: LeafLevels | None = None
    cycles: tuple[CyclesView, ...] = ()
    state: SceneState | None = None

    @property
    def warnings(self) -> tuple[str, ...]:
        """All notes."""
        return tuple(text for texts in self.notes.values() for text in texts)


@dataclass(frozen=True, eq=False)
class Before:
    """Existing octree whose grid a job reuses, with its light and codes if they fit.

    lit: whether its light fits. same_view: whether its light is of the same cameras. state: of its scene. coded,
    encoder: codes if they fit, and the encoder's name. warnings: of the octree.
    """

    octree: Octree
    layout: LeafLevels | None
    state: SceneState | None
    lit: bool
    same_view: bool = False
    coded: CodedOctree | None = None
    encoder: str = ""
    warnings: tuple[str, ...] = ()


def run_job(
    context: bpy.types.Context,
    settings: JobSettings,
    meanwhile: Meanwhile | None = None,
    before: Before | None = None,
    early: EarlyResult | None = None,
) -> Steps[JobResult]:
    """Read, voxelize, light and encode the scene, then refine the view of each camera; write files if wanted.

    meanwhile: shows unfinished pictures, the first one before the bake; None in background. before: existing octree.
    early: takes a result after each round of the light but the last, without references. Nothing is written if a step
    fails. Raises PatchNetError.
    """
    folders = view_folders(context.scene, settings.view.cameras)
    wanted = settings.view
    files, inputs = job_files(folders.values(), wanted.cycles, reference=wanted.has_reference), job_inputs(settings)
    output = output_folder(settings.out, files, inputs) if settings.out else nullcontext()
    with output as folder:
        plan = JobPlan(settings)
        job = _Job(context, settings, load_weights(settings.network.weights), plan, meanwhile, early)
        result = yield from plan.timed(_compute(job, before))
        plan.learn()
        for item in result.views:
            item.report["folder"] = folders[item.camera.name]
        if folder is not None:
            yield Progress(0, 1, "Writing files")
            write_result(folder, result)
    return result


@dataclass(frozen=True, eq=False)
class _Job:
    """Inputs of a job, see `run_job`."""

    context: bpy.types.Context
    settings: JobSettings
    weights: Weights
    plan: JobPlan
    meanwhile: Meanwhile | None
    early: EarlyResult | None


def _compute(job: _Job, before: Before | None) -> Steps[JobResult]:
    # A missing GPU is an error before the bake; torch is imported by the engine alone.
    yield from computed(found_device, job.settings.network.torch_device, NETWORK_DEVICE)
    made, cameras = yield from _lit(job, before)
    if isinstance(made, LitOctree):
        job.plan.resumed = made.reused > 0.0
    return (yield from _result(job, made, cameras))


def _result(job: _Job, made: LitOctree | Before, cameras: Sequence[Camera]) -> Steps[JobResult]:
    """Codes, views and report of a lit octree."""
    context, settings, clock, meanwhile = job.context, job.settings, job.plan.clock, job.meanwhile
    wanted = settings.view
    with clock.stage("views"):
        behind = yield from view_background(context, made.octree, cameras[0], settings)
    if meanwhile is not None:
        with clock.stage("first look"):
            yield from first_look(made.octree, cameras[0], meanwhile, background=behind.light)
    if isinstance(made, Before) and made.coded is not None:
        coded, encoder = made.coded, made.encoder
    else:
        with clock.stage("codes"):
            coded, encoder = yield from encode(made.octree, job.weights, settings.network)
    views: list[View] = []
    cycles: list[CyclesView] = []
    for camera in cameras:
        with clock.stage("views"):
            if camera is not cameras[0]:
                behind = yield from view_background(context, made.octree, camera, settings)
            looking = view(
                coded,
                camera,
                wanted,
                settings.surface.scope,
                background=behind,
                pixel_filter=pixel_filter_of(context.scene),
                meanwhile=meanwhile,
            )
            views.append((yield from looking))
        if wanted.cycles is not None:
            with clock.stage("cycles"):
                cycles.append((yield from refine_view(context, views[-1], wanted.cycles, sun=settings.light.daylight)))
            views[-1].report["cycles"] = cycles[-1].report
    unseen = dict.fromkeys(warning for told in (views, cycles) for item in told for warning in item.warnings)
    focus = focus_warnings(context.scene, cameras)
    others = estimators_warning(wanted.strategy, coded.weights)
    notes = {"octree": made.warnings, "codes": (others,) if others else (), "view": (*focus, *unseen)}
    report = _report(coded, views, settings, clock.seconds, sum(notes.values(), ())) | {"encoder": encoder}
    return JobResult(coded, tuple(views), report, notes, made.layout, tuple(cycles), made.state)


def _lit(job: _Job, before: Before | None) -> Steps[tuple[LitOctree | Before, list[Camera]]]:
    """Lit octree of a job, and its cameras; plans the job, shows a first look, and delivers early results."""
    context, settings, clock = job.context, job.settings, job.plan.clock
    wanted, overrides = settings.view, OctreeOverrides()
    cameras: list[Camera] = []
    if before is not None:
        cameras = yield from octree_cameras(context, before.octree, wanted.cameras, wanted.size)
        if before.lit:
            return before, cameras
        overrides = OctreeOverrides.on_grid_of(before.octree, before.layout, before.state)
    surface = yield from read_surface(context, settings, clock, overrides)
    fit: Sequence[Camera] = cameras
    if before is None:
        source, depsgraph = surface.source, context.evaluated_depsgraph_get()
        bounds_world = settings.surface.bounds_world(source)
        with clock.stage("depth"):
            cameras = yield from looking_cameras(depsgraph, wanted.cameras, wanted.size, bounds_world, source)
            fit = (yield from fit_cameras(context, settings, source)) if settings.surface.track else cameras
    choice = yield from choose_leaves(context, surface, clock, fit)
    job.plan.make(surface.source, choice, cameras)
    if settings.out is not None:
        check_room(settings.out, stored_bytes(choice.leaves, settings.contents), "The voxels")
    known_noise = _known_noise(before, surface)
    if job.meanwhile is not None and settings.light.is_baked and known_noise == np.inf:
        with clock.stage("first look"):
            yield from stand_in_look(surface.source, choice, settings, cameras[0], job.meanwhile)
    quick = replace(job, settings=settings.changed(reference=False, cycles=None), meanwhile=None)

    def deliver(made: LitOctree) -> Steps[None]:
        assert job.early is not None
        yield from job.early((yield from _result(quick, made, cameras)))

    each_round = None if job.early is None else deliver
    made = yield from light_octree(context, surface, choice, clock, each_round, known_noise)
    job.plan.layers = made.layers
    return made, cameras


def _known_noise(before: Before | None, surface: ReadSurface) -> float:
    """Noise of the present light of the same scene through the same cameras; infinite if there is none."""
    if before is None or not before.same_view or not surface.is_baked:
        return np.inf
    values = before.octree.provenance
    same = values.get("light") == CYCLES and values.get("scene_state") == surface.state.identity()
    return float(values.get(LIGHT_NOISE, np.inf)) if same else np.inf


def _report(
    coded: CodedOctree,
    views: Sequence[View],
    settings: JobSettings,
    timings_s: dict[str, float],
    warnings: Sequence[str],
) -> dict[str, Any]:
    """Report of all figures, as plain JSON values."""
    octree = coded.octree
    return {
        "octree": {
            "depth": octree.depth,
            "nodes": octree.node_count,
            "leaves": octree.leaf_count,
            "fitted": bool(octree.provenance.get("fitted", False)),
            "bytes": octree.nbytes,
            "voxel_world": octree.grid.voxel_size_world,
            "exposure": octree.exposure,
            "codes": len(coded.codes),
            "codes_bytes": coded.nbytes,
            **fine_light_values(octree),
        },
        "timings_s": timings_s,
        "frames": [item.report for item in views],
        "error_unit": ERROR_UNIT,
        "strategy": settings.view.strategy,
        "settings": recorded(settings.values, VIEW),
        "view_transform": VIEW_TRANSFORM,
        "light": octree.provenance,
        "warnings": list(warnings),
        # Curves and tables stand in the weights' model card.
        "weights": {"hash": coded.weights.hash}
        | {name: value for name, value in coded.weights.metadata.items() if isinstance(value, str | int | float)},
        "versions": versions(),
        "machine": machine(),
    }


def write_result(folder: Path, result: JobResult) -> None:
    """Write all files of a job."""
    save_octree(result.coded.octree, folder / OCTREE_NAME)
    save_codes(result.coded, folder / CODES_NAME)
    for item in result.views:
        save_view(item, folder / item.report["folder"])
    for item, refined in zip(result.views, result.cycles, strict=False):
        save_cycles(refined, folder / item.report["folder"], strategy(result.report["strategy"]).maximum)
    save_png(folder / OVERVIEW_NAME, overview(result.views))
    write_report(folder, "views", result.report)
