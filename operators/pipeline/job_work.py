# SPDX-License-Identifier: GPL-3.0-or-later
"""Work of a job's stages in units, and seconds per unit, learned from earlier jobs on this machine."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from contextlib import suppress

from ...patchnet_addon.lod.ray_rows import rows_apart
from ...patchnet_addon.runtime.bounds import MOST_STILLS, SMALL_PX
from ...patchnet_addon.runtime.cache_folder import user_cache_folder
from ...patchnet_addon.runtime.eta import JobEta, range_text
from ...patchnet_addon.runtime.owned_folder import owned_folder
from ...patchnet_addon.runtime.progress import Result, Steps, changed
from ...patchnet_addon.runtime.stage_clock import StageClock
from ...patchnet_addon.surface.scene_mesh import SceneMesh
from ...patchnet_addon.tracing.camera import Camera
from ..computing.grids import GridChoice
from ..schema.values import SEEN_CELLS
from ..settings.job_settings import JobSettings

FILE_NAME = "rates.json"
AGAIN = frozenset({"first look", "views", "cycles"})  # stages that a job enters several times
_KEPT = 0.7  # weight of earlier jobs after each further one
SPREAD, SPREAD_ELSEWHERE = 1.4, 2.0  # factors by which expected seconds may be shorter or longer
_LEAST_S = 1.0  # of work: stages with less take the time of starting Cycles or reading files
# Of a bake: surfels of a pixel in small and in large stills, of a leaf in a track, and where light is fine everywhere;
# their usual paths, where cameras stand still and where they move; choosing them, in paths of a leaf.
_IN_SMALL, _IN_LARGE, _IN_TRACK, _IN_LEAF = 4.0, 1.5, 0.05, 0.5
_USUAL_LAYERS = 1.3
_USUAL_SAMPLES, _SAMPLES_OF_TRACK, _CHOOSING = 8.0, 5.5, 0.25
# Of fitting leaves: cost of a triangle, a leaf and a pixel.
_OF_TRIANGLE, _OF_LEAF, _OF_PIXEL = 18.0, 0.5, 0.2
_REFERENCE_RAYS = 2 * 32**2  # and the other strategies, about
_VIEW_RAYS = 60  # cost of first rays, finer rays and the network, in rays of a refined pixel
# Seconds per unit on two cores of a server, for the first job on a machine; "frames": of the render engine, by rays.
_ELSEWHERE = {
    "read": 2e-6, "depth": 8.5e-7, "first look": 2e-6, "light": 4e-6, "voxelize": 1.2e-6, "codes": 2e-6, "views": 2e-8,
    "cycles": 2e-6, "frames": 3.6e-7,
}  # fmt: skip


def work_of(
    settings: JobSettings, *, pixels: int, triangles: int = 0, leaves: float = 0.0, cameras: Sequence[Camera] = ()
) -> dict[str, float]:
    """Units of work of each stage, in the order of the job; 0 for a stage that the job skips.

    pixels: of all cameras. triangles: of the surface. leaves: of the octree. cameras: those that light is baked for.
    """
    view, light = settings.view, settings.light
    rays = view.spp or 1.0 + view.budget * view.refined_samples
    cycles = 0.0 if view.cycles is None else pixels * view.cycles.budget * view.cycles.samples
    if view.cycles is not None and view.cycles.compare:
        cycles += 5.0 * pixels * view.cycles.samples
    surface = triangles + 100_000.0
    depth = _OF_TRIANGLE * surface
    if settings.surface.is_fitted:
        depth += _OF_LEAF * leaves + _OF_PIXEL * _traced(cameras or (), pixels)
    return {
        "read": surface,
        "depth": depth,
        "light": light_paths(settings, cameras, leaves=leaves) + _CHOOSING * leaves if light.is_baked else 0.0,
        "voxelize": leaves + surface,
        "codes": leaves,
        "views": pixels * (_VIEW_RAYS + rays + (_REFERENCE_RAYS if view.has_reference else 0.0)),
        "cycles": cycles,
    }


def _traced(cameras: Sequence[Camera], pixels: int) -> float:
    """Pixels whose rays choose leaves: of a long track's frames some rows each."""
    return max(float(pixels), sum(camera.pixel_count for camera in cameras) / rows_apart(len(cameras)))


def layers_of(pieces: float, leaves: int) -> float:
    """Pieces of surface in a leaf, over their usual number: more cost more in leaves and along rays."""
    return pieces / max(leaves, 1) / _USUAL_LAYERS


def light_paths(settings: JobSettings, cameras: Sequence[Camera], *, leaves: float) -> float:
    """Expected paths of a bake for cameras, or for leaves where light is fine everywhere."""
    light, surfels, samples = settings.light, _IN_LEAF * leaves, _USUAL_SAMPLES
    if light.cells == SEEN_CELLS and len(cameras) > MOST_STILLS:
        surfels, samples = _IN_TRACK * leaves, _SAMPLES_OF_TRACK
    elif light.cells == SEEN_CELLS and cameras:
        rates = [_IN_SMALL if camera.pixel_count <= SMALL_PX else _IN_LARGE for camera in cameras]
        surfels = sum(rate * camera.pixel_count for rate, camera in zip(rates, cameras, strict=True))
    return surfels * min(light.max_samples, samples)


class Rates:
    """Seconds per unit of each stage, learned from jobs on this machine, with defaults for the first job.

    A file in the cache folder holds them; without it, times are less exact.
    """

    def __init__(self) -> None:
        """Read what is known."""
        self._path = user_cache_folder() / FILE_NAME
        self._sums: dict[str, tuple[float, float]] = {}
        with suppress(OSError, ValueError, TypeError, AttributeError):
            known = json.loads(self._path.read_text(encoding="utf-8"))
            self._sums = {str(name): (float(seconds), float(units)) for name, (seconds, units) in known.items()}
        self.measured = bool(self._sums)  # at least one job was measured here

    def know(self, work: dict[str, float]) -> bool:
        """Return whether all stages that have enough work to learn from were measured here."""
        return all(name in self._sums for name, units in work.items() if _takes_time(name, units))

    def seconds(self, work: dict[str, float]) -> dict[str, float]:
        """Expected seconds of each stage."""
        return {name: units * self._rate(name) for name, units in work.items()}

    def _rate(self, name: str) -> float:
        seconds, units = self._sums.get(name, (0.0, 0.0))
        return seconds / units if seconds > 0.0 and units > 0.0 else _ELSEWHERE[name]

    def learn(self, work: dict[str, float], seconds: dict[str, float]) -> None:
        """Learn from the seconds of finished stages with enough work; large and recent jobs weigh more."""
        for name, units in work.items():
            if _takes_time(name, units) and seconds.get(name, 0.0) > 0.0:
                before = self._sums.get(name, (0.0, 0.0))
                self._sums[name] = _KEPT * before[0] + seconds[name], _KEPT * before[1] + units
        with suppress(OSError), owned_folder(self._path) as folder:
            (folder / FILE_NAME).write_text(json.dumps(self._sums), encoding="utf-8")
            os.replace(folder / FILE_NAME, self._path)


def _takes_time(name: str, units: float) -> bool:
    return units * _ELSEWHERE[name] >= _LEAST_S


def time_line(seconds: dict[str, float], rates: Rates) -> str:
    """Sentence on the time of a whole job."""
    total, spread = sum(seconds.values()), SPREAD if rates.measured else SPREAD_ELSEWHERE
    text = f"Takes {range_text(total / spread, total * spread)}"
    return text if rates.measured else f"{text} (measured elsewhere)"


class JobPlan:
    """Expected and measured time of a job.

    resumed: whether light came from the cache, so that the bake's seconds are not learned. layers: of the octree, see
    `layers_of`; the usual number until it is known.
    """

    def __init__(self, settings: JobSettings) -> None:
        self.clock, self.resumed, self.layers = StageClock(), False, 1.0
        self._eta, self._settings, self._rates = JobEta(AGAIN), settings, Rates()
        self._work_with: Callable[[float], dict[str, float]] = lambda _layers: {}

    def make(self, source: SceneMesh, choice: GridChoice, cameras: Sequence[Camera], *stages: str) -> None:
        """Plan the job for a surface and grid. stages: of the job; all if none are named."""
        pixels, triangles = sum(camera.pixel_count for camera in cameras), source.triangle_count
        seen = choice.cameras or cameras

        def work(layers: float) -> dict[str, float]:
            leaves = layers * choice.leaves
            units = work_of(self._settings, pixels=pixels, triangles=triangles, leaves=leaves, cameras=seen)
            return {name: units[name] for name in stages or units}

        self._work_with = work
        self._eta.expect(self._rates.seconds(work(1.0)), measured=self._rates.know(work(1.0)))

    def timed(self, steps: Steps[Result]) -> Steps[Result]:
        """Add the progress of the whole job to its steps."""
        return changed(steps, lambda report: self._eta.see(self.clock.present, report))

    def learn(self) -> None:
        """Learn the seconds of stages, except those that compiled kernels or resumed a bake."""
        unlike = self._eta.compiled | ({"light"} if self.resumed else set())
        work = self._work_with(self.layers)
        self._rates.learn({name: units for name, units in work.items() if name not in unlike}, self.clock.seconds)
