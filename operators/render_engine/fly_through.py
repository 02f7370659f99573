# SPDX-License-Identifier: GPL-3.0-or-later
"""Fly-through: frames of the render engine with one bake for all of them, and its expected time beside Cycles."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import ceil
from pathlib import Path

import bpy
import numpy as np

from ...patchnet_addon.runtime.errors import OutputError, SceneError
from ...patchnet_addon.runtime.eta import range_text
from ...patchnet_addon.runtime.outputs import check_writable
from ...patchnet_addon.runtime.progress import Steps
from ...patchnet_addon.runtime.quantities import bytes_text, counted
from ...patchnet_addon.tracing.camera import Camera
from ..cycles.daylight import has_light
from ..cycles.pixel_renders import pixel_renders
from ..pipeline.estimate import Estimate, estimate_job
from ..pipeline.job_work import SPREAD, SPREAD_ELSEWHERE, JobPlan, Rates
from ..pipeline.lit_octree import OctreeOverrides, choose_leaves, light_octree, read_surface
from ..properties.job import scene_settings
from ..scene.cameras import camera_size_px, choose_cameras
from ..scene.track import kept_track, track_cameras, track_key
from ..scene_access.overrides import changed
from ..schema.table import COMBINED, GLOSS_CAMERA, LIGHT, OCTREE
from ..session import results
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
_BYTES_A_PIXEL = 2  # of a compressed picture, about
_MOVES = (
    "Objects, lights or materials change from frame to frame, so no bake is of all frames: press Bake Animation, or "
    "render an animation with the engine PatchNet without a window"
)
_BAKE = "read", "depth", "light", "voxelize"


@dataclass(frozen=True, eq=False)
class BakedFlyThrough:
    """Voxels and light for the frames that are to be rendered; none if all are in the folder."""

    frames: tuple[int, ...]
    folder: Path
    result: SceneResult | None = None


def bake_fly_through(
    context: bpy.types.Context, frames: range, told: Callable[[FlyThrough], None]
) -> Steps[BakedFlyThrough]:
    """Bake what frames need that are missing; `told` gets the expected times before. Raises PatchNetError.

    With automatic depth, All Frames is ticked: the render engine shows such voxels. What fits is not made again.
    """
    scene = context.scene
    missing = missing_frames(scene, frames)
    folder = check_room(scene, len(missing))
    if not missing:
        return BakedFlyThrough((), folder)
    if scene_state(scene).frame is not None:
        raise SceneError(_MOVES)
    scene.patchnet.track = True
    settings = fly_through_settings(scene)
    there = _kept(scene, settings)
    if there is None:
        estimate, seen = yield from estimate_fly_through(context, settings, len(missing))
        estimate.settings = recorded(scene.patchnet, *ESTIMATED)
        session_of(scene).estimate = estimate
        told(seen)
        there = yield from _baked(context, settings)
    return BakedFlyThrough(tuple(missing), folder, there)


def render_fly_through(scene: bpy.types.Scene, frames: range, missing: int) -> None:
    """Render frames that are missing now, and learn how long they take. Raises SceneError."""
    begin = time.perf_counter()
    with frames_by_engine(scene, frames):
        try:
            bpy.ops.render.render(animation=True, scene=scene.name)
        except RuntimeError as cause:
            raise SceneError(str(cause).strip().removeprefix("Error: ")) from cause
    width, height = camera_size_px(scene)
    rays = {"frames": float(missing * _rays(scene, width * height))}
    Rates().learn(rays, {"frames": time.perf_counter() - begin})


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


def check_room(scene: bpy.types.Scene, frames: int) -> Path:
    """Folder of the scene's pictures; raises OutputError where it cannot be written, or has no room for them."""
    folder = Path(bpy.path.abspath(scene.render.frame_path(frame=scene.frame_start))).parent
    folder.mkdir(parents=True, exist_ok=True)
    check_writable(folder)
    percent = scene.render.resolution_percentage / 100
    wanted = int(frames * _BYTES_A_PIXEL * scene.render.resolution_x * scene.render.resolution_y * percent**2)
    free = shutil.disk_usage(folder).free
    if free < wanted:
        raise OutputError(
            f"{counted(frames, 'frame')} take about {bytes_text(wanted)}, and {folder} has {bytes_text(free)}: make "
            "room, or choose another folder in Output"
        )
    return folder


@dataclass(frozen=True)
class FlyThrough:
    """Expected seconds: of what is done once, of a frame, and of a frame by Cycles by its samples.

    measured: frames of earlier fly-throughs on this machine. What is done once depends most on the scene.
    """

    frames: int
    once: float
    frame: float
    cycles: dict[int, float]
    measured: bool

    def lines(self) -> list[str]:
        """Figures in words, for the panel."""
        film = counted(self.frames, "frame")
        bake = range_text(self.once / SPREAD_ELSEWHERE, self.once * SPREAD_ELSEWHERE)
        lines = [f"Bake {bake}, {film} {self._range(self.frames * self.frame)}"]
        rivals = [f"{self._range(self.frames * one)} with {samples} samples" for samples, one in self.cycles.items()]
        lines.append(f"Cycles, denoised: {', '.join(rivals)}")
        samples, slowest = max(self.cycles.items())
        gained = slowest - self.frame
        ahead = f"ahead from {counted(max(1, ceil(self.once / gained)), 'frame')} on" if gained > 0.0 else "never ahead"
        lines.append(f"PatchNet is {ahead} of Cycles with {samples}")
        return lines if self.measured else [*lines, "Times of frames were measured elsewhere"]

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
    rays = {"frames": float(_rays(scene, camera.pixel_count))}
    reading, sample = yield from _cycles_seconds(context, camera)
    seen = FlyThrough(
        frames,
        sum(found.seconds.get(name, 0.0) for name in _BAKE),
        rates.seconds(rays)["frames"],
        {samples: reading + samples * sample for samples in RIVALS},
        rates.know(rays),
    )
    found.lines += seen.lines()
    return found, seen


def _rays(scene: bpy.types.Scene, pixels: int) -> int:
    """Rays of a frame, about."""
    samples = scene.patchnet.render_samples
    return pixels * (samples_side(samples) ** 2 if samples else 20)


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
    plan.resumed = made.reused > 0.0
    plan.learn()
    result = SceneResult(made.octree, wanted.scope, made.layout, settings.light.kind, state=made.state)
    result.seconds, result.notes = dict(clock.seconds), {"octree": made.warnings}
    results.keep(scene, result, OCTREE, LIGHT, settings=settings)
    return result


def _kept(scene: bpy.types.Scene, settings: JobSettings) -> SceneResult | None:
    there = result_or_kept(scene)
    if there is None or there.unfinished:
        return None
    look_again(there, scene)
    same = all(there.made_by.get(stage) == settings.key(stage) for stage in (OCTREE, LIGHT))
    same = same and there.made_by.get("track") == track_key(scene, settings.surface.fitted_track)
    return there if same and not there.stale else None
