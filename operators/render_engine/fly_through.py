# SPDX-License-Identifier: GPL-3.0-or-later
"""Fly-through: frames of the render engine with one bake for all of them, and its expected time beside Cycles."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import ceil
from pathlib import Path

import bpy
import numpy as np

from ...patchnet_addon.runtime.errors import SceneError
from ...patchnet_addon.runtime.eta import duration_text, range_text
from ...patchnet_addon.runtime.outputs import check_room, check_writable
from ...patchnet_addon.runtime.progress import Steps
from ...patchnet_addon.runtime.quantities import counted
from ...patchnet_addon.tracing.camera import Camera
from ..cycles.daylight import has_light
from ..cycles.pixel_renders import pixel_renders
from ..pipeline.estimate import Estimate, estimate_job
from ..pipeline.job_work import SPREAD, SPREAD_ELSEWHERE, JobPlan, Rates
from ..pipeline.lit_octree import OctreeOverrides, choose_leaves, light_octree, read_surface
from ..properties.job import scene_settings
from ..scene.cameras import choose_cameras
from ..scene.track import kept_track, track_cameras, track_key
from ..scene_access.overrides import changed
from ..schema.values import COMBINED, GLOSS_CAMERA, LIGHT, OCTREE
from ..session.keep import keep
from ..session.octree_cache import result_or_kept
from ..session.scene_result import SceneResult
from ..session.scene_session import session_of
from ..session.staleness import look_again
from ..settings.groups import samples_side
from ..settings.job_settings import ESTIMATED, JobSettings, recorded
from ..state.scene_state import scene_state
from .engine import ENGINE

RIVALS = 8, 32  # samples of denoised Cycles renders whose errors are next to those of frames (docs/worth-it.md)
_PROBE_PX = 1 << 17
_RAYS = 20  # of a pixel by a budget, about
_BYTES_A_PIXEL = 2  # of a compressed picture, about
_MOVES = (
    "Objects, lights or materials change from frame to frame, so no bake is of all frames: press Bake Animation, or "
    "render an animation with the engine PatchNet without a window"
)
_BAKE = "read", "depth", "light", "voxelize"


@dataclass(frozen=True, eq=False)
class BakedFlyThrough:
    """Voxels and light for the frames that are to be rendered; none if all are in the folder.

    work: units of a frame for `Rates`; empty without an estimate.
    """

    frames: tuple[int, ...]
    folder: Path
    result: SceneResult | None = None
    work: dict[str, float] = field(default_factory=dict)


def bake_fly_through(
    context: bpy.types.Context, frames: range, told: Callable[[FlyThrough], None]
) -> Steps[BakedFlyThrough]:
    """Bake what frames need that are missing; `told` gets the expected times before. Raises PatchNetError.

    With automatic depth, All Frames is ticked: the render engine shows such voxels. What fits is not made again.
    """
    scene = context.scene
    missing = missing_frames(scene, frames)
    folder = pictures_folder(scene, len(missing))
    if not missing:
        return BakedFlyThrough((), folder)
    if scene_state(scene).frame is not None:
        raise SceneError(_MOVES)
    scene.patchnet.track = True
    settings = fly_through_settings(scene)
    there, work = _kept(scene, settings), {}
    if there is None:
        estimate, seen = yield from estimate_fly_through(context, settings, len(missing))
        estimate.settings = recorded(scene.patchnet, *ESTIMATED)
        session_of(scene).estimate = estimate
        told(seen)
        there, work = (yield from _baked(context, settings)), seen.work
    return BakedFlyThrough(tuple(missing), folder, there, work)


def render_fly_through(scene: bpy.types.Scene, frames: range, baked: BakedFlyThrough) -> None:
    """Render frames that are missing, and learn how long they take. Raises SceneError."""
    begin = time.perf_counter()
    with frames_by_engine(scene, frames):
        try:
            bpy.ops.render.render(animation=True, scene=scene.name)
        except RuntimeError as cause:
            raise SceneError(str(cause).strip().removeprefix("Error: ")) from cause
    work = {name: len(baked.frames) * units for name, units in baked.work.items()}
    Rates().learn(work, {"frames": time.perf_counter() - begin})


@contextmanager
def frames_by_engine(scene: bpy.types.Scene, frames: range) -> Iterator[None]:
    """Let the scene render these frames with the engine, without those that are there, within the block."""
    with (
        kept_track(scene),
        changed(scene.render, engine=ENGINE, use_overwrite=False),
        changed(scene, frame_start=frames[0], frame_end=frames[-1], frame_step=frames.step),
    ):
        yield


def fly_through_settings(scene: bpy.types.Scene) -> JobSettings:
    """Settings of the render engine, with voxels of automatic depth fitted to the whole track. Raises SettingError."""
    settings = scene_settings(scene)
    settings = settings.changed(cameras=(), size=(0, 0), from_camera=settings.light.gloss == GLOSS_CAMERA)
    return settings.changed(track=settings.surface.is_fitted)


def missing_frames(scene: bpy.types.Scene, frames: range) -> list[int]:
    """Frames whose pictures are not in the scene's output folder; all of a film, which is one file."""
    if scene.render.is_movie_format:
        return list(frames)
    return [number for number in frames if not Path(scene.render.frame_path(frame=number)).is_file()]


def pictures_folder(scene: bpy.types.Scene, frames: int) -> Path:
    """Folder of the scene's pictures; raises OutputError where it cannot be written, or has no room for them."""
    folder = Path(bpy.path.abspath(scene.render.frame_path(frame=scene.frame_start))).parent
    folder.mkdir(parents=True, exist_ok=True)
    check_writable(folder)
    pixels = scene.render.resolution_x * scene.render.resolution_y * (scene.render.resolution_percentage / 100) ** 2
    check_room(folder, frames * _BYTES_A_PIXEL * pixels, counted(frames, "frame"))
    return folder


def frames_until_ahead(once_s: float, ours_s: float, peer_s: float) -> int | None:
    """Least N with once + N ours <= N peer; None if there is none."""
    return max(1, ceil(once_s / (peer_s - ours_s))) if ours_s < peer_s else None


@dataclass(frozen=True)
class FlyThrough:
    """Expected seconds: of what is done once, of a frame, and of a frame by Cycles by its samples.

    measured: bakes and frames of earlier fly-throughs on this machine. work: units of a frame.
    """

    frames: int
    once: float
    frame: float
    cycles: dict[int, float]
    measured: bool
    work: dict[str, float] = field(default_factory=dict)

    def lines(self) -> list[str]:
        """Figures in words, for the panel."""
        film, once = counted(self.frames, "frame"), duration_text(self.once)
        whole = self._range(self.once + self.frames * self.frame)
        lines = [f"{film} {whole}: bake about {once}, a frame {self.frame:.2g} s"]
        rivals = [f"{self._range(self.frames * one)} with {samples} samples" for samples, one in self.cycles.items()]
        lines.append(f"Cycles, denoised: {', '.join(rivals)}")
        samples, slowest = max(self.cycles.items())
        first = frames_until_ahead(self.once, self.frame, slowest)
        ahead = "never ahead" if first is None else f"ahead from {counted(first, 'frame')} on"
        lines.append(f"PatchNet is {ahead} of Cycles with {samples}")
        return lines if self.measured else [*lines, "Times of PatchNet were measured elsewhere"]

    def _range(self, seconds: float) -> str:
        spread = SPREAD if self.measured else SPREAD_ELSEWHERE
        return range_text(seconds / spread, seconds * spread)


def estimate_fly_through(
    context: bpy.types.Context, settings: JobSettings, frames: int
) -> Steps[tuple[Estimate, FlyThrough]]:
    """Estimate of a fly-through, with two renders of its present frame by Cycles; raises PatchNetError."""
    scene, rates = context.scene, Rates()
    found = yield from estimate_job(context, settings)
    (camera,) = choose_cameras(context.evaluated_depsgraph_get(), (), (0, 0), np.zeros((2, 3)))
    samples = scene.patchnet.render_samples
    rays = samples_side(samples) ** 2 if samples else _RAYS
    work = {"frames": found.layers * rays * camera.pixel_count}
    once = {name: seconds for name, seconds in found.seconds.items() if name in _BAKE}
    reading, sample = yield from _cycles_seconds(context, camera)
    seen = FlyThrough(
        frames,
        sum(once.values()),
        rates.seconds(work)["frames"],
        {samples: reading + samples * sample for samples in RIVALS},
        rates.know(once | work),
        work,
    )
    found.lines += seen.lines()
    return found, seen


def _cycles_seconds(context: bpy.types.Context, camera: Camera) -> Steps[tuple[float, float]]:
    """Seconds in which Cycles reads the scene, and of a sample in each pixel of a frame."""
    share = min(1.0, (_PROBE_PX / camera.pixel_count) ** 0.5)
    small = camera.with_size(max(int(share * camera.width_px), 4), max(int(share * camera.height_px), 4))
    sun = not has_light(context.evaluated_depsgraph_get())
    with pixel_renders(context, small, COMBINED, sun=sun) as cycles:
        yield from cycles.synced()
        reading = cycles.sync_seconds
        yield from cycles.picture(2, 0, "Cycles, a frame", at_once=True)
        return reading, (cycles.seconds - reading) / 2.0 * (camera.pixel_count / small.pixel_count)


def _baked(context: bpy.types.Context, settings: JobSettings) -> Steps[SceneResult]:
    """New voxels with the light of all frames, which the scene keeps."""
    scene, wanted, plan = context.scene, settings.surface, JobPlan(settings)
    clock, overrides = plan.clock, OctreeOverrides()
    if wanted.track:
        overrides = OctreeOverrides(cameras=lambda: track_cameras(scene, (), (0, 0), wanted.track_frames))
    surface = yield from read_surface(context, settings, clock, overrides)
    choice = yield from choose_leaves(context, surface, clock)
    plan.make(surface.source, choice, choice.cameras, *_BAKE)
    made = yield from plan.timed(light_octree(context, surface, choice, clock))
    plan.resumed, plan.layers = made.reused > 0.0, made.layers
    plan.learn()
    result = SceneResult(made.octree, wanted.scope, made.layout, settings.light.kind, state=made.state)
    result.seconds, result.notes = dict(clock.seconds), {"octree": made.warnings}
    keep(scene, result, OCTREE, LIGHT, settings=settings)
    return result


def _kept(scene: bpy.types.Scene, settings: JobSettings) -> SceneResult | None:
    there = result_or_kept(scene)
    if there is None or there.unfinished:
        return None
    look_again(there, scene)
    same = all(there.made_by.get(stage) == settings.key(stage) for stage in (OCTREE, LIGHT))
    same = same and there.made_by.get("track") == track_key(scene, settings.surface.fitted_track)
    return there if same and not there.stale else None
