# SPDX-License-Identifier: GPL-3.0-or-later
"""Bake the light of a surface, round by round (methods 7.2e to 7.2h).

Cycles computes the light that arrives on surfels, small triangles just above the surface that no ray meets. The first
round gives all of them a few paths; further ones go where the picture would still be noisy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache, partial
from typing import TYPE_CHECKING, Any

import bpy
import numpy as np

from ....patchnet_addon.export.fine_light import FINE_LIGHT, LIGHT_NOISE, WANTED_NOISE
from ....patchnet_addon.runtime.progress import Progress, Steps
from ....patchnet_addon.runtime.source_hash import source_hash
from ....patchnet_addon.runtime.worker import computed
from ....patchnet_addon.tracing.empty_view import BLACK_VIEWS
from ...scene.fingerprint import surface_hash
from ...scene_access.devices import bakes_on_gpu
from ...state.digest import Digest, composed
from ...state.watch import check_unchanged
from .bake_job import BakeJob, ChosenSurfels, choose
from .baker import SurfelBaker
from .black_views import black_views

if TYPE_CHECKING:  # they bring numba, which nothing imports before it computes
    from ....patchnet_addon.light.light_cells import LightCells
    from ....patchnet_addon.light.rounds import Round
    from ....patchnet_addon.light.surface_light import BakedColors, SurfaceLight
    from ....patchnet_addon.light.surfel_cache import SurfelCache

# Triangles up to which a bake call has as many surfels: each reads the whole scene, so large scenes have few calls;
# many give finer progress, and lose less when they are stopped.
_CALL_SURFELS = ((200_000, 1 << 18), (1_000_000, 1 << 20), (np.inf, 1 << 22))
_COLOR_SAMPLES = 16  # of a base colour
LIGHT_PATHS = "light_paths"  # entry of the octree's file
_code_hash = cache(lambda: source_hash("operators.cycles.bake.bake"))  # with its imports

EachRound = Callable[["SurfaceLight"], Steps[None]]


def bake_light(job: BakeJob, each_round: EachRound | None = None) -> Steps[SurfaceLight]:
    """Diffuse light with global illumination, and emission, on the surface of a job.

    each_round: takes the light after each round but the last. The result's notes hold the share of leaves with fine
    light, the noise that is left, and the paths of surfels. Raises SceneError if Cycles is missing or cannot bake,
    SettingError for a GPU that is not enabled.
    """
    from ....patchnet_addon.light.light_cells import SurfelSums
    from ....patchnet_addon.light.rounds import first_round, next_round

    light = job.light
    baker = SurfelBaker(job.context, job.source, light, job.clipped.grid.side_world, device=job.device)
    chosen = yield from choose(job)
    colors = yield from _baked_colors(job, baker, chosen)
    kept = None if not job.state else _opened(job)
    sums, reused = SurfelSums.zeros(len(chosen.surfels), baker.channels), 0
    now: Round | None = first_round(len(chosen.surfels), light.max_samples)
    while now is not None:
        baked, found = yield from _round(job, baker, now, chosen.surfels[now.surfels], kept)
        sums.add(now.surfels, _in_proportion(baked, chosen, now.surfels), now.samples)
        reused += found
        cells = yield from computed(partial(chosen.grid.light, sums), Progress(0, 1, "Filtering light"))
        now = next_round(now, cells, light.noise_threshold, light.max_samples)
        lit = yield from computed(partial(_lit, job, chosen, cells, colors, baker), Progress(0, 1, "Reading textures"))
        lit.notes[LIGHT_PATHS] = int(sums.samples.sum())
        if now is not None and each_round is not None:
            yield from each_round(lit)
    reasons = yield from computed(lambda: black_views(job, chosen, cells, lit), Progress(0, 1, "Looking for light"))
    if reasons:
        lit.notes[BLACK_VIEWS] = reasons
    if lit.notes[LIGHT_NOISE] > light.noise_threshold:  # Max Samples came first
        lit.notes[WANTED_NOISE] = light.noise_threshold
    return replace(lit, reused=reused / max(int(sums.samples.sum()), 1))


def _round(
    job: BakeJob, baker: SurfelBaker, now: Round, surfels: np.ndarray, kept: SurfelCache | None
) -> Steps[tuple[np.ndarray, int]]:
    """Baked light (n, channels) of the surfels of a round, and how many paths of them were kept."""
    baked, there = np.zeros((len(surfels), baker.channels), np.float32), np.zeros(len(surfels), bool)
    if kept is not None:
        yield Progress(0, 1, "Looking for finished light")
        baked, there = kept.load(now.number, surfels["id"], now.samples, baker.channels)
        if there.any():
            yield Progress(int(there.sum()), len(surfels), f"Resuming: {there.mean():.0%} of the light is there")
    left = np.flatnonzero(~there)
    label = "Baking light" if now.number == 0 else f"Refining light, round {now.number + 1}"
    done = 0
    for mine in _calls(job, left):
        at = Progress(done, len(left), label)
        done += len(mine)
        yield at
        baked[mine] = yield from baker.bake(surfels[mine], now.samples, now.number, at)
        check_unchanged()  # the cache must not get light of a changed scene
        if kept is not None:
            kept.save(now.number, surfels["id"][mine], now.samples, baked[mine])
    yield Progress(len(left), len(left), label)
    return baked, int(there.sum()) * now.samples


def _calls(job: BakeJob, surfels: np.ndarray) -> Iterator[np.ndarray]:
    """Surfels (n,) of each bake call."""
    size = next(size for limit, size in _CALL_SURFELS if job.source.triangle_count <= limit)
    return (surfels[first : first + size] for first in range(0, len(surfels), size))


def _baked_colors(job: BakeJob, baker: SurfelBaker, chosen: ChosenSurfels) -> Steps[BakedColors | None]:
    """Base colours that are baked: of leaves, and of surfels, which get theirs as `base`; None if there are none."""
    from ....patchnet_addon.light.light_cells import SurfelSums
    from ....patchnet_addon.light.surface_light import BakedColors
    from ....patchnet_addon.surface.textures import LEAST_BASE

    if chosen.colored is None:
        return None
    mine = np.flatnonzero(chosen.has_baked_color[chosen.surface.material])
    found = yield from _colors_of(job, baker, chosen.surfels[mine])
    chosen.surface.base[mine] = np.maximum(found[:, :-2], LEAST_BASE)
    leaves = chosen.colored.surfels
    sums = SurfelSums.zeros(len(leaves), baker.channels)
    sums.add(np.arange(len(leaves)), (yield from _colors_of(job, baker, leaves)), _COLOR_SAMPLES)
    return BakedColors(chosen.colored.grid.light(sums), chosen.has_baked_color)


def _colors_of(job: BakeJob, baker: SurfelBaker, surfels: np.ndarray) -> Steps[np.ndarray]:
    """Base colours (n, channels) of surfels."""
    found = np.zeros((len(surfels), baker.channels), np.float32)
    for mine in _calls(job, np.arange(len(surfels))):
        at = Progress(int(mine[0]), len(surfels), "Baking colors")
        found[mine] = yield from baker.bake(surfels[mine], _COLOR_SAMPLES, 0, at, colors=True)
    found[:, -2] = 1.0
    return found


def _in_proportion(baked: np.ndarray, chosen: ChosenSurfels, surfels: np.ndarray) -> np.ndarray:
    """Baked light (n, channels) of surfels (n,) in proportion to their base color.

    Light over a baked color is multiplied by it. Surfels on the black of an emission texture do not count.
    """
    from ....patchnet_addon.surface.textures import LEAST_BASE

    material, base = chosen.surface.material[surfels], chosen.surface.base[surfels]
    mine = chosen.has_baked_color[material]
    baked[mine, :-2] *= base[mine]
    baked[mine, -1] *= base[mine, 0]
    baked[chosen.glows[material] & (base[:, 0] <= LEAST_BASE)] = 0.0
    return baked


def _lit(
    job: BakeJob, chosen: ChosenSurfels, cells: LightCells, colors: BakedColors | None, baker: SurfelBaker
) -> SurfaceLight:
    from ....patchnet_addon.light.rounds import usual_noise
    from ....patchnet_addon.light.surface_light import MaterialSides, SurfaceLight, cells_shade

    sides = MaterialSides(chosen.reflects, chosen.through)
    shade = cells_shade(cells, chosen.table, chosen.sheets, sides, color=job.light.color, colors=colors)
    notes: dict[str, Any] = {FINE_LIGHT: round(chosen.fine, 4), LIGHT_NOISE: round(usual_noise(cells), 5)}
    return SurfaceLight(shade, chosen.reflects, baker.warnings, notes)


def _opened(job: BakeJob) -> SurfelCache:
    from ....patchnet_addon.light.surfel_cache import SurfelCache

    return SurfelCache(bake_key(job))


def bake_key(job: BakeJob) -> str:
    """32 hex digits over everything that the light of a surfel depends on."""
    light, scene, digest = job.light, job.context.scene, Digest()
    digest.struct(scene.cycles)  # also what changes bits alone, such as the sampling pattern
    switches: tuple[object, ...] = light.color, bakes_on_gpu(job.context, job.device), bool(light.daylight), light.gloss
    if light.from_camera and scene.camera is not None:
        switches += tuple(map(tuple, scene.camera.matrix_world))
    blender = bpy.app.version_string, bpy.app.build_hash, _devices()
    grid = job.clipped.grid.origin_world, job.clipped.grid.side_world
    return composed(_code_hash(), *blender, job.state, surface_hash(job.source), digest.hexdigest(), grid, switches)


def _devices() -> tuple[str, ...]:
    """Devices of Cycles, whose results differ in their last bits."""
    try:
        import _cycles  # type: ignore[import-not-found]
    except ImportError:
        return ()
    return tuple(str(device[:2]) for device in _cycles.available_devices("NONE"))
