# SPDX-License-Identifier: GPL-3.0-or-later
"""State of a bake: chosen surfels, their paths so far, and the light of their cells (methods 7.2e to 7.2h).

It stays in the process that computes. Cycles bakes the surfels in Blender's process, call by call.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..octree.grid import Grid
from ..process.transfer import Remote
from ..runtime.progress import Progress, Steps
from ..surface.light import SurfaceLight
from ..surface.scene_mesh import SceneMesh
from ..surface.textures import LEAST_BASE
from ..tracing.camera import Camera
from .black_views import black_views
from .chosen_surfels import ChosenSurfels, ColoredLeaves
from .placed_sheets import placed_sheets
from .rounds import Round, first_round, next_round, usual_noise
from .surfel_cache import SurfelCache

if TYPE_CHECKING:  # they bring numba, which nothing imports before it computes
    from ..octree.voxelize import ClippedSurface
    from ..surface.mesh import Fragments, Shading, ShadingFn, TriangleBatch
    from .light_cells import LightCells, SurfelSums
    from .seen_cells import SeenCells
    from .sheets import Sheets
    from .surface_light import BakedColors

COLOR_SAMPLES = 16  # of a base colour
_CHOOSING, _FILTERING = Progress(0, 1, "Choosing surfels"), Progress(0, 1, "Filtering light")
_READING, _LOOKING = Progress(0, 1, "Reading textures"), Progress(0, 1, "Looking where cameras look")


class BakePlan(NamedTuple):
    """What is baked.

    cameras: they decide which sides of closed sheets get light; if `cells_by_cameras`, also which light cells are fine,
    else all are. lookahead: levels, of the weights in use. color: with colour. denoise: light is filtered over cells.
    noise_threshold, max_samples: bounds of a surfel's paths. through: (M,) bool, see `MaterialSides`. has_baked_color:
    (M,) bool, materials whose base colours are baked.
    kept: folder of bakes, and key of the surfels that are kept on disk; None for none.
    """

    cameras: tuple[Camera, ...]
    cells_by_cameras: bool
    lookahead: int
    color: bool
    denoise: bool
    noise_threshold: float
    max_samples: int
    through: np.ndarray
    has_baked_color: np.ndarray
    kept: tuple[Path, str] | None = None

    @property
    def channels(self) -> int:
        """Of baked light: luminance, with colour red, green and blue, opacity, and half a difference."""
        return 6 if self.color else 3


class _Part(NamedTuple):
    """Surfels that are baked before the next ones are chosen: rows (n,) of `surfels` SURFEL, their places (n,) among
    all of the part, and the baked light (m, channels) of all.
    """

    surfels: np.ndarray
    rows: np.ndarray
    places: np.ndarray
    baked: np.ndarray


@dataclass(eq=False)
class LightBake:
    """Bake of a surface's light. now: the round in work, None after the last; colors: None if none is baked."""

    source: SceneMesh
    grid: Grid
    plan: BakePlan
    chosen: ChosenSurfels
    sums: SurfelSums
    kept: SurfelCache | None
    now: Round | None
    part: _Part | None = None
    colors: BakedColors | None = None
    cells: LightCells | None = None
    light: SurfaceLight | None = None


class BegunBake(NamedTuple):
    """Bake, and whether base colours are baked first."""

    bake: Remote[LightBake]
    has_colors: bool


class BegunRound(NamedTuple):
    """Round: number, paths of each of its surfels, their number, and that of those whose light is not kept on disk."""

    number: int
    samples: int
    surfels: int
    left: int


class EndedRound(NamedTuple):
    """Light after a round, share of leaves with fine light, noise of pictures, paths of all rounds so far."""

    light: Remote[SurfaceLight]
    fine: float
    noise: float
    paths: int
    is_last: bool


def begin_bake(source: SceneMesh, clipped: ClippedSurface, plan: BakePlan) -> Steps[BegunBake]:
    """Choose the surfels of a surface. clipped: it in its leaves."""
    from .light_cells import SurfelSums

    chosen = yield from _chosen(source, clipped, plan)
    kept = None if plan.kept is None else SurfelCache(plan.kept[1], plan.kept[0])
    count = len(chosen.surfels)
    now = first_round(count, plan.max_samples)
    bake = LightBake(source, clipped.grid, plan, chosen, SurfelSums.zeros(count, plan.channels), kept, now)
    return BegunBake(Remote(bake), chosen.colored is not None)


def _chosen(source: SceneMesh, clipped: ClippedSurface, plan: BakePlan) -> Steps[ChosenSurfels]:
    from ..lod.fit import leaves_of
    from ..surface.shading import opacity_shade
    from .light_cells import CellGrid, reflecting, surface_of_surfels
    from .seen_cells import all_cells, seen_cells
    from .surfels import choose_surfels, eyes_of

    materials, cameras = source.materials, plan.cameras if plan.cells_by_cameras else ()
    yield _READING
    table = clipped.table
    opacity = opacity_shade(source, table)
    yield _LOOKING
    leaves = yield from leaves_of(clipped, opacity)
    yield _LOOKING
    if cameras:
        seen = yield from seen_cells(leaves.nodes, clipped.grid, cameras, lookahead=plan.lookahead)
    else:
        seen = all_cells(leaves.keys)
    yield Progress(0, 1, "Inspecting sheets")
    sheets, eyes = placed_sheets(source, plan.cameras, plan.through), eyes_of(cameras)
    yield _CHOOSING
    surfels = yield from choose_surfels(clipped, opacity, sheets, seen, eyes)
    yield _CHOOSING
    reflects = reflecting(table, [material.base_is_known for material in materials])
    at = surface_of_surfels(surfels, source, table, reflects, color=plan.color)
    even = [each.base_is_known and each.base_texture is None and max(each.base_color) > 0.0 for each in materials]
    glows, has_baked_color = np.array([each.glows for each in materials], bool), plan.has_baked_color
    # Emission has no noise, and may be black beside white; what reflects beside it has, if it is of one color.
    at = at._replace(is_filtered=((reflects & ~glows) | has_baked_color | np.array(even, bool))[at.material])
    colored = None
    if has_baked_color[at.material].any():
        colored = yield from _colored_leaves(clipped, opacity, sheets, seen, eyes, has_baked_color)
    yield _FILTERING
    grid = CellGrid(surfels, at, clipped.grid, filtered=plan.denoise)
    fine = len(seen.cells) / max(sum(len(keys) for keys in leaves.keys.values()), 1)
    return ChosenSurfels(
        surfels, at, grid, sheets, leaves.nodes, table, reflects, min(fine, 1.0), colored, glows
    )  # fmt: skip


def _colored_leaves(
    clipped: ClippedSurface, opacity: ShadingFn, sheets: Sheets, seen: SeenCells, eyes: np.ndarray, which: np.ndarray
) -> Steps[ColoredLeaves]:
    """Choose surfels in voxels that cameras see, on materials `which` (M,); elsewhere they are as coarse as light."""
    from .light_cells import CellGrid, surface_of_surfels
    from .surfels import choose_surfels

    def shown(batch: TriangleBatch, fragments: Fragments) -> Shading:
        shading = opacity(batch, fragments)
        return shading._replace(opacity=shading.opacity * which[batch.materials[fragments.triangle]])

    surfels = yield from choose_surfels(clipped, shown, sheets, seen, eyes, is_color=True)
    yield _CHOOSING
    known = np.zeros(len(which), bool)
    surface = surface_of_surfels(surfels, clipped.source, clipped.table, known, color=False)
    return ColoredLeaves(surfels, CellGrid(surfels, surface, clipped.grid, filtered=False))


def begin_colors(bake: LightBake, of_leaves: bool) -> int:
    """Number of surfels whose base colours are baked next: those of leaves, or those of light."""
    chosen = bake.chosen
    assert chosen.colored is not None
    if of_leaves:
        surfels, rows = chosen.colored.surfels, np.arange(len(chosen.colored.surfels))
    else:
        surfels, rows = chosen.surfels, np.flatnonzero(bake.plan.has_baked_color[chosen.surface.material])
    baked = np.zeros((len(rows), bake.plan.channels), np.float32)
    bake.part = _Part(surfels, rows, np.arange(len(rows)), baked)
    return len(rows)


def end_colors(bake: LightBake, of_leaves: bool) -> None:
    """Take the base colours of the part: leaves' as cells, surfels' as the base of their light."""
    from .light_cells import SurfelSums
    from .surface_light import BakedColors

    part, chosen = bake.part, bake.chosen
    assert part is not None and chosen.colored is not None
    found = part.baked
    found[:, -2] = 1.0
    if of_leaves:
        sums = SurfelSums.zeros(len(found), bake.plan.channels)
        sums.add(part.rows, found, COLOR_SAMPLES)
        bake.colors = BakedColors(chosen.colored.grid.light(sums), bake.plan.has_baked_color)
    else:
        chosen.surface.base[part.rows] = np.maximum(found[:, :-2], LEAST_BASE)
    bake.part = None


def begin_round(bake: LightBake) -> BegunRound:
    """Begin the next round with the light that is kept on disk."""
    now, surfels = bake.now, bake.chosen.surfels
    assert now is not None
    count = len(now.surfels)
    baked, there = np.zeros((count, bake.plan.channels), np.float32), np.zeros(count, bool)
    if bake.kept is not None:
        baked, there = bake.kept.load(now.number, surfels["id"][now.surfels], now.samples, bake.plan.channels)
    left = np.flatnonzero(~there)
    bake.part = _Part(surfels, now.surfels[left], left, baked)
    return BegunRound(now.number, now.samples, count, len(left))


def surfels_of(bake: LightBake, first: int, last: int) -> np.ndarray:
    """Surfels first to last of the part that are left to bake: (n,) SURFEL."""
    assert bake.part is not None
    return bake.part.surfels[bake.part.rows[first:last]]


def take_light(bake: LightBake, first: int, baked: np.ndarray, keeps: bool) -> None:
    """Take the baked light (n, channels) of the part's surfels from `first` on. keeps: on disk, if the bake does."""
    part, now = bake.part, bake.now
    assert part is not None and now is not None
    mine = slice(first, first + len(baked))
    part.baked[part.places[mine]] = baked
    if keeps and bake.kept is not None:
        bake.kept.save(now.number, part.surfels["id"][part.rows[mine]], now.samples, baked)


def end_round(bake: LightBake) -> Steps[EndedRound]:
    """Light of the cells with the round's paths, and the choice of the next round's surfels."""
    from .surface_light import MaterialSides, cells_shade

    now, part, chosen, plan = bake.now, bake.part, bake.chosen, bake.plan
    assert now is not None and part is not None
    yield _FILTERING
    bake.sums.add(now.surfels, _in_proportion(part.baked, bake, now.surfels), now.samples)
    bake.part = None
    bake.cells = cells = chosen.grid.light(bake.sums)
    bake.now = next_round(now, cells, plan.noise_threshold, plan.max_samples)
    yield _READING
    sides = MaterialSides(chosen.reflects, plan.through)
    shade = cells_shade(cells, chosen.table, chosen.sheets, sides, color=plan.color, colors=bake.colors)
    bake.light = SurfaceLight(shade, chosen.reflects)
    paths, is_last = int(bake.sums.samples.sum()), bake.now is None
    return EndedRound(Remote(bake.light), chosen.fine, usual_noise(cells), paths, is_last)


def _in_proportion(baked: np.ndarray, bake: LightBake, surfels: np.ndarray) -> np.ndarray:
    """Baked light (n, channels) of surfels (n,) in proportion to their base color.

    Light over a baked color is multiplied by it. Surfels on the black of an emission texture do not count.
    """
    chosen = bake.chosen
    material, base = chosen.surface.material[surfels], chosen.surface.base[surfels]
    mine = bake.plan.has_baked_color[material]
    baked[mine, :-2] *= base[mine]
    baked[mine, -1] *= base[mine, 0]
    baked[chosen.glows[material] & (base[:, 0] <= LEAST_BASE)] = 0.0
    return baked


def why_black(bake: LightBake, lost: tuple[str, ...], without_gloss: bool) -> Steps[dict[str, str]]:
    """Reasons of `black_views` after the last round. lost: sentences about what was not baked."""
    assert bake.cells is not None and bake.light is not None
    return black_views(
        bake.source, bake.grid, bake.plan.cameras, bake.chosen, bake.cells, bake.light.shade,
        lookahead=bake.plan.lookahead, without_gloss=without_gloss, lost=lost,
    )  # fmt: skip
