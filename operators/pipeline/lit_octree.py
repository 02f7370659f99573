# SPDX-License-Identifier: GPL-3.0-or-later
"""Pipeline from a scene to its lit octree: read the surface, choose its leaves for cameras, light it, build the octree.

Operators, the render engine, animations, `verify-light` and the command line use it: `build_lit_octree`, or its three
steps.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import astuple, dataclass, field, replace
from typing import TYPE_CHECKING, Any

import bpy
import numpy as np

from ...patchnet_addon.export.fine_light import LIGHT_NOISE
from ...patchnet_addon.network.weights import load_weights
from ...patchnet_addon.octree.leaf_levels import LeafLevels
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.process.computed import computed
from ...patchnet_addon.process.transfer import Remote
from ...patchnet_addon.runtime.errors import SceneError
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.runtime.stage_clock import StageClock
from ...patchnet_addon.surface.scene_mesh import SceneMesh
from ...patchnet_addon.tracing.camera import Camera
from ..computing.grids import GridChoice
from ..computing.octrees import UNLIT, Building, LitSurface, build_octree, cut_surface
from ..cycles.bake.gloss_passes import baked_with_gloss, seen_through, with_view
from ..cycles.daylight import has_light
from ..scene.cameras import AUTO, choose_cameras, looking_cameras
from ..scene.precision import light_warnings, thin_warnings
from ..scene.read import scene_surface
from ..scene.track import track_cameras
from ..schema.values import SEEN_CELLS, SELECTED
from ..settings.job_settings import JobSettings
from ..state.digest import composed
from ..state.watch import read_state, with_gloss_from_camera
from .job_work import layers_of
from .stages import NO_LIGHT, choose_grid, provenance

if TYPE_CHECKING:
    from ...patchnet_addon.octree.voxelize import ClippedSurface
    from ..state.scene_state import SceneState


EachOctree = Callable[["LitOctree"], Steps[None]]


@dataclass(frozen=True, eq=False)
class OctreeOverrides:
    """Inputs of an octree that replace those of the settings and the context.

    unlit: the surface's own colour, without baked light. grid: given cube and levels, which must still contain the
    surface; None chooses them. cameras: those that leaves are fitted to, at the current frame; None takes those of
    the settings. depsgraph: read instead of the context's. baking: context in which Cycles bakes. rotation: seed of a
    random rotation of the lit surface, 0 for none. bisect: axis and share of a plane at which the lit surface is cut
    open, None for none; not with a rotation. chosen: session_uids of objects that count as the selected ones.
    provenance: further entries of the octree's file.
    """

    unlit: bool = False
    grid: GridChoice | None = None
    cameras: Callable[[], Sequence[Camera]] | None = None
    depsgraph: bpy.types.Depsgraph | None = None
    baking: Callable[[], AbstractContextManager[None]] = nullcontext
    rotation: int = 0
    bisect: tuple[int, float] | None = None
    chosen: frozenset[int] | None = None
    provenance: dict[str, Any] = field(default_factory=dict)

    @staticmethod
    def on_grid_of(octree: Octree, layout: LeafLevels | None, state: SceneState | None) -> OctreeOverrides:
        """Overrides for an octree on the grid of another one, of the same objects whatever is selected now."""
        chosen = None if state is None else state.chosen
        return OctreeOverrides(grid=GridChoice(octree.grid, layout, leaves=octree.leaf_count), chosen=chosen)


@dataclass(frozen=True, eq=False)
class ReadSurface:
    """Surface read by settings and overrides. state: of the scene."""

    settings: JobSettings
    overrides: OctreeOverrides
    source: SceneMesh
    state: SceneState

    @property
    def is_baked(self) -> bool:
        """Return whether Cycles bakes its light."""
        return self.settings.light.is_baked and not self.overrides.unlit


@dataclass(frozen=True, eq=False)
class LitOctree:
    """Lit octree with its inputs.

    layout: levels of its leaves, None where all are on the deepest. light: "none", "cycles" or "two-lights".
    source: the surface. state: of the scene when it was read. warnings: sentences about assumptions and omissions.
    layers: see `layers_of`. reused: share of the paths of its light that an earlier bake had traced.
    """

    octree: Octree
    layout: LeafLevels | None
    light: str
    source: SceneMesh
    state: SceneState
    warnings: tuple[str, ...]
    layers: float
    reused: float = 0.0


def build_lit_octree(
    context: bpy.types.Context,
    settings: JobSettings,
    clock: StageClock,
    overrides: OctreeOverrides | None = None,
) -> Steps[LitOctree]:
    """Octree of the scene by settings. Raises PatchNetError.

    clock: records the stages "read", "depth", "light" and "voxelize".
    """
    surface = yield from read_surface(context, settings, clock, overrides or OctreeOverrides())
    choice = yield from choose_leaves(context, surface, clock)
    return (yield from light_octree(context, surface, choice, clock))


def read_surface(
    context: bpy.types.Context, settings: JobSettings, clock: StageClock, overrides: OctreeOverrides
) -> Steps[ReadSurface]:
    """Read the surface of the scene. Raises SceneError."""
    if settings.light.is_baked and not overrides.unlit:
        names, track = settings.view.cameras, settings.surface.track
        settings = replace(settings, light=with_view(context.scene, settings.light, names, track=track))
    with clock.stage("read"):
        yield Progress(0, 1, "Reading the scene")
        scene, layer, selected = context.scene, "", settings.surface.scope == SELECTED
        if overrides.depsgraph is not None:
            scene, layer = overrides.depsgraph.scene.original, overrides.depsgraph.view_layer.name
        # First, so that changes between two steps are noticed.
        state = yield from read_state(scene, layer, selected=selected, chosen=overrides.chosen)
        yield Progress(0, 1, "Reading the scene")
        depsgraph = overrides.depsgraph or context.evaluated_depsgraph_get()
        source = yield from scene_surface(depsgraph, settings.surface.scope, overrides.chosen)
        depsgraph = overrides.depsgraph or context.evaluated_depsgraph_get()
        if settings.light.is_baked and settings.light.daylight is None:
            settings = settings.changed(daylight=not has_light(depsgraph))
        if settings.light.is_baked:
            source = seen_through(source, settings.light.gloss)
        # With the place of the camera if gloss is baked for it.
        seen = settings.light.is_baked and not overrides.unlit and bool(settings.light.from_camera)
        if seen and baked_with_gloss(source, settings.light.gloss).any():
            state = with_gloss_from_camera(state, scene)
        return ReadSurface(settings, overrides, source, state)


def choose_leaves(
    context: bpy.types.Context, surface: ReadSurface, clock: StageClock, cameras: Sequence[Camera] | None = None
) -> Steps[GridChoice]:
    """Choose grid and levels for cameras; None takes the overrides' or the settings'. Raises PatchNetError."""
    overrides, source, settings = surface.overrides, surface.source, surface.settings
    with clock.stage("depth"):
        if overrides.grid is not None:
            corners = overrides.grid.grid.to_unit(source.bounds_world)
            if corners.min() < 0.0 or corners.max() > 1.0:
                raise SceneError("Objects have moved out of the voxels, or others are selected: run Voxelize again")
            choice = overrides.grid
        else:
            if cameras is None and overrides.cameras is not None:
                cameras = overrides.cameras()
            elif cameras is None:
                cameras = yield from fit_cameras(context, settings, source)
            choice = yield from choose_grid(source, cameras, settings)
        if surface.is_baked and not cameras:
            with suppress(SceneError):  # a scene without cameras is baked, too
                cameras = yield from _looking(context, settings, source, overrides.depsgraph)
    return replace(choice, cameras=cameras or ())


def light_octree(
    context: bpy.types.Context,
    surface: ReadSurface,
    choice: GridChoice,
    clock: StageClock,
    each_round: EachOctree | None = None,
    known_noise: float = np.inf,
) -> Steps[LitOctree]:
    """Light the surface and build its octree. Raises PatchNetError.

    each_round: takes the octree after each round of a bake but the last, if it is less noisy than what is known,
    unless baking a further round took less time than that.
    """
    overrides, source, settings = surface.overrides, surface.source, surface.settings
    coarse = light_warnings(source, choice.grid) if surface.is_baked else ()
    with clock.stage("voxelize"):
        wanted = source, choice.grid, choice.layout, settings, overrides.rotation
        cut = yield from computed(cut_surface, *wanted, at=Progress(0, 1, "Planning the voxels"))

    def built(lit: LitSurface, *, is_last: bool = False) -> Steps[LitOctree]:
        kind = UNLIT if overrides.unlit else settings.light.kind
        entries = provenance(source, settings, kind) | lit.notes | _scene_entries(surface)
        building = Building(kind, entries, overrides.rotation, overrides.bisect, is_last)
        with clock.stage("voxelize"):
            parts = cut.clipped, cut.turned, lit.light, settings, building
            octree = yield from computed(build_octree, *parts, at=Progress(0, 1, "Voxelizing"))
        thin = thin_warnings(source, choice.grid, choice.cameras)
        own_color = () if surface.is_baked else source.color_warnings
        assumed = (NO_LIGHT,) if surface.is_baked and settings.light.daylight else ()
        read = *source.warnings, *surface.state.warnings
        warnings = (*read, *own_color, *choice.warnings, *thin, *coarse, *lit.warnings, *assumed)
        layers = layers_of(cut.fragments, octree.leaf_count)
        return LitOctree(octree, choice.layout, kind, source, surface.state, warnings, layers, lit.reused)

    ended_at, showing_s = time.perf_counter(), 0.0

    def shown(lit: LitSurface) -> Steps[None]:
        nonlocal ended_at, showing_s
        begin = time.perf_counter()
        if each_round is None or lit.notes.get(LIGHT_NOISE, 0.0) >= known_noise:
            return
        if begin - ended_at < showing_s:  # the next round shows more
            return
        yield from each_round((yield from built(lit)))
        ended_at = time.perf_counter()
        showing_s = ended_at - begin

    with overrides.baking():
        with clock.stage("light"):
            lit = yield from _light(context, surface, cut.clipped, choice, shown)
        return (yield from built(lit, is_last=True))


def _light(
    context: bpy.types.Context,
    surface: ReadSurface,
    clipped: Remote[ClippedSurface],
    choice: GridChoice,
    each_round: Callable[[LitSurface], Steps[None]],
) -> Steps[LitSurface]:
    """Light of the surface by the settings."""
    from ..cycles.bake import BakeJob, bake_light

    settings = surface.settings
    if not surface.is_baked:
        return LitSurface()
    job = BakeJob(
        context=context,
        source=surface.source,
        clipped=clipped,
        grid=choice.grid,
        cameras=tuple(choice.cameras),
        light=settings.light,
        lookahead=load_weights(settings.network.weights).lookahead,
        state=surface.state.identity(context.scene.frame_subframe),
    )
    return (yield from bake_light(job, each_round))


def _scene_entries(surface: ReadSurface) -> dict[str, Any]:
    """Entries of the octree's file about its scene."""
    overrides = surface.overrides
    entries: dict[str, Any] = {}
    if not (overrides.rotation or overrides.bisect):
        entries["scene_state"] = surface.state.identity()
        if surface.state.gloss_from:
            entries["gloss_from"] = surface.state.gloss_from
    return entries | overrides.provenance


def fit_cameras(context: bpy.types.Context, settings: JobSettings, source: SceneMesh) -> Steps[list[Camera]]:
    """Cameras that leaves are fitted to: none for a given depth, those at all frames of a track.

    Raises SceneError.
    """
    view = settings.view
    if settings.surface.track and list(view.cameras) != [AUTO]:  # automatic cameras are fixed
        return track_cameras(context.scene, view.cameras, view.size, settings.surface.track_frames)
    if not settings.surface.is_fitted:
        return []
    return (yield from _looking(context, settings, source, None))


def _looking(
    context: bpy.types.Context, settings: JobSettings, source: SceneMesh, depsgraph: bpy.types.Depsgraph | None
) -> Steps[list[Camera]]:
    view, bounds_world = settings.view, settings.surface.bounds_world(source)
    graph = depsgraph or context.evaluated_depsgraph_get()
    return looking_cameras(graph, view.cameras, view.size, bounds_world, source)


def cameras_key(context: bpy.types.Context, settings: JobSettings) -> str:
    """32 hex digits over the cameras that leaves or light are fitted to; "" if neither is. Raises SceneError."""
    light = settings.light
    if not (settings.surface.is_fitted or (light.is_baked and light.cells == SEEN_CELLS)):
        return ""
    names, size, surface = settings.view.cameras, settings.view.size, settings.surface
    if surface.track and list(names) != [AUTO]:
        return composed(cameras_text(track_cameras(context.scene, names, size, surface.track_frames)))
    wanted = names, size, np.array([[0.0] * 3, [1.0] * 3])
    with nullcontext() if settings.surface.is_fitted else suppress(SceneError):
        return composed(cameras_text(choose_cameras(context.evaluated_depsgraph_get(), *wanted)))
    return ""


def cameras_text(cameras: Sequence[Camera]) -> str:
    """All values of cameras as text."""
    return repr([[np.asarray(value).tolist() for value in astuple(each)] for each in cameras])
