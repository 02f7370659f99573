# SPDX-License-Identifier: GPL-3.0-or-later
"""Voxelizer, from triangles to surface sums per leaf cell: clip, shade, add up, batch by batch, block by block."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Protocol, TypeVar

import numpy as np

from ..runtime.bounds import INT32_COUNT, check_count
from ..runtime.progress import Progress, Steps
from ..runtime.threads import executor, usable_cores
from ..surface.mesh import Fragments, MeshSource, ShadingFn, TriangleBatch
from ..surface.texture_lookup import BaseColors, base_of_fragments, surface_of_fragments
from ..surface.textures import TextureTable
from ..surface.triangles import triangle_areas_and_normals
from .accumulate import LeafAccumulator, LeafSums
from .blocks import CellSet, all_cells, plan_passes, tasks_of, to_cells
from .clip import clip_triangles
from .collect_pieces import PieceCollector
from .grid import Grid
from .leaf_levels import BLOCK_FRAGMENTS, LeafLevels

Kept = TypeVar("Kept")
Watch = Callable[[TriangleBatch, Fragments, np.ndarray], None]

KEPT_BYTES = 40  # of a fragment that is kept
_BATCHES_AHEAD = 2


class LeafDetail(NamedTuple):
    """What leaves keep beside the mean luminance and normal of their surface.

    boxes: of the finest leaves. sides: luminance by direction. only_keys: nothing but their cells, without sums; takes
    less memory. base: colours of the surface, with which leaves keep their pieces.
    """

    boxes: bool = False
    sides: bool = False
    only_keys: bool = False
    base: BaseColors | None = None


PLAIN_LEAVES = LeafDetail()


class ClippedSurface:
    """Surface on a grid, cut into the fragments of its leaves once, if all of them may be kept.

    Otherwise each `voxelize` clips it again. passes: the planned ones, expected: fragments, see `plan_passes`.
    """

    def __init__(
        self,
        source: MeshSource,
        grid: Grid,
        layout: LeafLevels | None = None,
        *,
        block_fragments: int = BLOCK_FRAGMENTS,
        keep_bytes: float = BLOCK_FRAGMENTS * KEPT_BYTES,
        color: bool = False,
    ) -> None:
        """Plan the passes; reads the triangles once.

        layout: the leaves' levels, at most the grid's depth; None: all on that level. block_fragments: about as many
        have their leaves in memory at a time; for more, there are several passes over blocks of space. keep_bytes: of
        fragments, with their base luminance and opacity, if they take no more; 0 for none. color: `table` has colour.
        """
        self.source, self.grid = source, grid
        self.layout = layout or LeafLevels.uniform(grid.depth)
        self.passes, self.expected = plan_passes(source, grid, self.layout, block_fragments, usable_cores())
        self._kept: dict[tuple[int, int], list[Fragments]] = {}
        self._keeps, self._color = self.expected * KEPT_BYTES < keep_bytes, color

    def fragments(
        self, share: int, batch: TriangleBatch, areas_world: np.ndarray, cells: dict[int, CellSet]
    ) -> Iterator[Fragments]:
        """Fragments of a batch, with areas (T,), in the cells of a share of all passes, level by level."""
        number = share, batch.first_triangle
        kept = self._kept.get(number) if self._keeps else self._kept.pop(number, None)
        if kept is not None:
            yield from kept
            return
        made: Iterator[Fragments] = (
            fragments
            for level, wanted in cells.items()
            for fragments in clip_batch(batch, self.grid, areas_world, level, wanted)
            if len(fragments)
        )
        if self._keeps:
            self._kept[number] = [self._with_surface(batch, fragments) for fragments in made]
            made = iter(self._kept[number])
        yield from made

    def let_go(self) -> None:
        """Let go of kept fragments once they are used again."""
        self._keeps = False

    def _with_surface(self, batch: TriangleBatch, fragments: Fragments) -> Fragments:
        """Fragments with their base luminance and opacity, instead of the outlines that these were looked up by."""
        surface = surface_of_fragments(self.table, batch, fragments)
        return replace(fragments, surface=surface, cut_keys=None, corners_voxel=None)

    @cached_property
    def table(self) -> TextureTable:
        """Textures of the surface's materials."""
        return TextureTable.from_materials(self.source.materials, color=self._color)


class CoreShare(Protocol):
    """What a core does with the batches of a surface."""

    def add(self, batch: TriangleBatch, areas_world: np.ndarray, normals: np.ndarray) -> None:
        """Take a batch of triangles with areas (T,) and unit normals (T, 3)."""


def voxelize(
    clipped: ClippedSurface,
    shade: ShadingFn,
    keep: Callable[[list[LeafSums], int], Kept],
    *,
    watch: Watch | None = None,
    detail: LeafDetail = PLAIN_LEAVES,
) -> Steps[list[Kept]]:
    """Clip every triangle of a surface against the leaf cells and integrate the shading of the pieces.

    If there are several passes, the triangles are read again for each, over blocks of space in Morton order. Each core
    has its own blocks of a pass. `keep` receives the leaves of these, level by level, coarse first, and the level of
    the blocks, and returns the part to keep. `watch` receives batch, fragments and their luminance. Both and `shade`
    are called in threads. The leaves do not depend on this division, nor on the order of triangles, unless `shade`
    does.
    """
    kept: list[Kept] = []
    source, grid, passes = clipped.source, clipped.grid, clipped.passes
    for number, ranges in enumerate(passes):
        shares = []
        for index, blocks in enumerate(ranges, number * len(ranges)):
            cells = blocks.cells()
            leaves = {
                level: LeafAccumulator(grid.side_world / (1 << level), sides=detail.sides, only_keys=detail.only_keys)
                for level in cells
            }
            pieces = {} if detail.base is None else {level: PieceCollector() for level in cells}
            shares.append(
                _Share(clipped, index, blocks.layout.block_level, cells, leaves, pieces, shade, watch, detail)
            )
        done, total = number * source.triangle_count, len(passes) * source.triangle_count
        for report in on_all_cores(shares, source):
            yield Progress(done + report, total, "Voxelizing")
        with executor(len(shares)) as pool:
            kept += pool.map(lambda share: keep(share.take(), share.block_level), shares)
    return kept


@dataclass(frozen=True, eq=False)
class _Share:
    """Part of a pass for one core: the leaves of some blocks, by level; others as in `voxelize`."""

    clipped: ClippedSurface
    number: int
    block_level: int
    cells: dict[int, CellSet]
    leaves: dict[int, LeafAccumulator]
    pieces: dict[int, PieceCollector]
    shade: ShadingFn
    watch: Watch | None
    detail: LeafDetail

    def add(self, batch: TriangleBatch, areas_world: np.ndarray, normals: np.ndarray) -> None:
        """Clip, shade and sum up the batch's triangles, with areas (T,) and unit normals (T, 3)."""
        for fragments in self.clipped.fragments(self.number, batch, areas_world, self.cells):
            shading = self.shade(batch, fragments)
            if self.watch is not None:
                self.watch(batch, fragments, shading.luminance)
            self.leaves[fragments.level].add(fragments, shading, normals)
            if self.detail.base is not None:
                base = base_of_fragments(self.detail.base, batch, fragments, color=len(shading.color) > 0)
                self.pieces[fragments.level].add(batch, fragments, shading, base)

    def take(self) -> list[LeafSums]:
        """Take the leaves, level by level, and release them here."""
        taken = []
        for level in self.cells:
            if len(self.leaves[level]):
                own = self.leaves.pop(level).take(level)
                pieces = self.pieces.pop(level).take(own.keys) if self.pieces else None
                taken.append(replace(own, pieces=pieces))
        return taken


def on_all_cores(shares: Sequence[CoreShare], source: MeshSource) -> Iterator[int]:
    """Pass all triangles to all shares, each in its own thread; yields the number of triangles passed.

    Kernels run without the interpreter lock. A queue of batches keeps a slow share from blocking the others.
    """
    pools = [executor(1) for _ in shares]
    waiting: deque[list[Callable[[], None]]] = deque()
    done = 0
    try:
        for batch in source.batches():
            areas, normals = triangle_areas_and_normals(batch.corners_world)
            waiting.append(
                [
                    pool.submit(share.add, batch, areas, normals).result
                    for pool, share in zip(pools, shares, strict=True)
                ]
            )
            while len(waiting) > _BATCHES_AHEAD:
                _finish(waiting.popleft())
            done += len(batch)
            yield done
        while waiting:
            _finish(waiting.popleft())
    finally:
        for pool in pools:
            pool.shutdown(cancel_futures=True)


def _finish(results: Sequence[Callable[[], None]]) -> None:
    for result in results:
        result()


def clip_batch(
    batch: TriangleBatch, grid: Grid, areas_world: np.ndarray, level: int, wanted: CellSet | None = None
) -> Iterator[Fragments]:
    """Fragments of a batch in the wanted cells of a level, in groups of a few hundred thousand, in a fixed order.

    Raises SettingError for a batch of more than 2^31 triangles.
    """
    check_count(len(batch), INT32_COUNT, f"triangles of '{batch.name}'", "split the object")
    corners_voxel = to_cells(batch.corners_world, grid, level)
    chosen = wanted or all_cells(level)
    for task in tasks_of(corners_voxel, 1 << level, chosen):
        made = clip_triangles(corners_voxel, areas_world, *task, 1 << level, chosen.near, chosen.block)
        yield replace(Fragments(*made), level=level)
