# SPDX-License-Identifier: GPL-3.0-or-later
"""Bake the light of a surface, round by round (methods 7.2e to 7.2h).

Cycles computes the light that arrives on surfels, small triangles just above the surface that no ray meets. The first
round gives all of them a few paths; further ones go where the picture would still be noisy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import bpy
import numpy as np

from ....patchnet_addon.export.fine_light import FINE_LIGHT, LIGHT_NOISE, WANTED_NOISE
from ....patchnet_addon.light.light_bake import (
    COLOR_SAMPLES,
    BegunRound,
    EndedRound,
    begin_colors,
    begin_round,
    end_colors,
    end_round,
    surfels_of,
    take_light,
    why_black,
)
from ....patchnet_addon.light.surfel_cache import bakes_folder
from ....patchnet_addon.process.computed import computed
from ....patchnet_addon.process.transfer import Remote
from ....patchnet_addon.runtime.progress import Progress, Steps
from ....patchnet_addon.runtime.source_hash import code_hash
from ....patchnet_addon.tracing.empty_view import BLACK_VIEWS
from ...computing.octrees import LitSurface
from ...scene.fingerprint import surface_hash
from ...scene_access.devices import bakes_on_gpu
from ...schema.values import GLOSS_OFF
from ...state.digest import Digest, composed
from ...state.watch import check_unchanged
from .bake_job import BakeJob, begin
from .baker import SurfelBaker

if TYPE_CHECKING:
    from ....patchnet_addon.light.light_bake import LightBake

# Triangles up to which a bake call has as many surfels: each reads the whole scene, so large scenes have few calls;
# many give finer progress, and lose less when they are stopped.
_CALL_SURFELS = ((200_000, 1 << 18), (1_000_000, 1 << 20), (np.inf, 1 << 22))
LIGHT_PATHS = "light_paths"  # entry of the octree's file
_CODE = "operators.cycles.bake.bake"  # with its imports

EachRound = Callable[[LitSurface], Steps[None]]


def bake_light(job: BakeJob, each_round: EachRound | None = None) -> Steps[LitSurface]:
    """Diffuse light with global illumination, and emission, on the surface of a job.

    each_round: takes the light after each round but the last. The result's notes hold the share of leaves with fine
    light, the noise that is left, and the paths of surfels. Raises SceneError if Cycles is missing or cannot bake,
    SettingError for a GPU that is not enabled.
    """
    light = job.light
    baker = SurfelBaker(job.context, job.source, light, job.grid.side_world, device=light.device)
    kept = None
    if job.state:
        code = yield from computed(code_hash, _CODE, at=Progress(0, 1, "Reading textures"))
        kept = bakes_folder(), bake_key(job, code)
    bake, has_colors = yield from begin(job, kept)
    if has_colors:
        yield from _bake_colors(job, baker, bake)
    reused, is_last = 0, False
    while not is_last:
        reused += yield from _bake_round(job, baker, bake)
        ended: EndedRound = yield from computed(end_round, bake, at=Progress(0, 1, "Filtering light"))
        notes: dict[str, Any] = {FINE_LIGHT: round(ended.fine, 4), LIGHT_NOISE: round(ended.noise, 5)}
        notes[LIGHT_PATHS], is_last = ended.paths, ended.is_last
        if not is_last and each_round is not None:
            yield from each_round(LitSurface(ended.light, notes, baker.warnings))
    looking = bake, baker.warnings, light.gloss == GLOSS_OFF
    reasons = yield from computed(why_black, *looking, at=Progress(0, 1, "Looking for light"))
    if reasons:
        notes[BLACK_VIEWS] = reasons
    if notes[LIGHT_NOISE] > light.noise_threshold:  # Max Samples came first
        notes[WANTED_NOISE] = light.noise_threshold
    return LitSurface(ended.light, notes, baker.warnings, reused / max(ended.paths, 1))


def _bake_colors(job: BakeJob, baker: SurfelBaker, bake: Remote[LightBake]) -> Steps[None]:
    """Bake base colours: of surfels, then of leaves."""
    for of_leaves in (False, True):
        count = yield from computed(begin_colors, bake, of_leaves, at=Progress(0, 1, "Baking colors"))
        for first, last in _calls(job, count):
            at = Progress(first, count, "Baking colors")
            surfels = yield from computed(surfels_of, bake, first, last, at=at)
            found = yield from baker.bake(surfels, COLOR_SAMPLES, 0, at, colors=True)
            yield from computed(take_light, bake, first, found, False, at=at)
        yield from computed(end_colors, bake, of_leaves, at=Progress(count, count, "Baking colors"))


def _bake_round(job: BakeJob, baker: SurfelBaker, bake: Remote[LightBake]) -> Steps[int]:
    """Bake the surfels of a round; returns how many paths of them were kept."""
    looking = Progress(0, 1, "Looking for finished light" if job.state else "Baking light")
    now: BegunRound = yield from computed(begin_round, bake, at=looking)
    there = now.surfels - now.left
    if there:
        yield Progress(there, now.surfels, f"Resuming: {there / now.surfels:.0%} of the light is there")
    label = "Baking light" if now.number == 0 else f"Refining light, round {now.number + 1}"
    for first, last in _calls(job, now.left):
        at = Progress(first, now.left, label)
        surfels = yield from computed(surfels_of, bake, first, last, at=at)
        baked = yield from baker.bake(surfels, now.samples, now.number, at)
        check_unchanged()  # the cache must not get light of a changed scene
        yield from computed(take_light, bake, first, baked, True, at=at)
    yield Progress(now.left, now.left, label)
    return there * now.samples


def _calls(job: BakeJob, count: int) -> Iterator[tuple[int, int]]:
    """First and last of `count` surfels in each bake call."""
    size = next(size for limit, size in _CALL_SURFELS if job.source.triangle_count <= limit)
    return ((first, min(first + size, count)) for first in range(0, count, size))


def bake_key(job: BakeJob, code: str) -> str:
    """32 hex digits over everything that the light of a surfel depends on. code: hash of the code that bakes it."""
    light, scene, digest = job.light, job.context.scene, Digest()
    digest.struct(scene.cycles)  # also what changes bits alone, such as the sampling pattern
    on_gpu = bakes_on_gpu(job.context, light.device)
    switches: tuple[object, ...] = light.color, on_gpu, bool(light.daylight), light.gloss
    if light.from_camera and scene.camera is not None:
        switches += tuple(map(tuple, scene.camera.matrix_world))
    blender = bpy.app.version_string, bpy.app.build_hash, _devices()
    grid = job.grid.origin_world, job.grid.side_world
    return composed(code, *blender, job.state, surface_hash(job.source), digest.hexdigest(), grid, switches)


def _devices() -> tuple[str, ...]:
    """Devices of Cycles, whose results differ in their last bits."""
    try:
        import _cycles  # type: ignore[import-not-found]
    except ImportError:
        return ()
    return tuple(str(device[:2]) for device in _cycles.available_devices("NONE"))
