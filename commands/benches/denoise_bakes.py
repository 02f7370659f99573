# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes that `patchnet bench denoise` compares: one of few paths, and its reference of many on the same charts."""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import bpy

    from ...operators.cycles.bake.page_mesh import PageTriangles
    from ...operators.scene.scene_mesh import SceneMesh
    from ...operators.settings.groups import LightSettings
    from ...patchnet_addon.lightmap.atlas import Atlas
    from ...patchnet_addon.lightmap.charts import Charts
    from ...patchnet_addon.runtime.progress import Steps


@dataclass(frozen=True, eq=False)
class Bakes:
    """Surface with its light of few paths and of many.

    halves: of few paths, as Denoise has them baked, in two halves that tell its noise. plain: of as many, as bakes
    without Denoise have them, where the reference was baked. more: of more paths than that, by their number, likewise.
    reference: of many; it knows its noise.
    """

    source: SceneMesh
    halves: Atlas
    plain: Atlas
    more: dict[int, Atlas]
    reference: Atlas


def bakes_of(args: argparse.Namespace) -> Steps[Bakes]:
    """Bake the scene that is open as the arguments of the bench say; raises PatchNetError."""
    import bpy

    from ...operators.cycles.bake.bake import page_side
    from ...operators.cycles.daylight import has_light
    from ...operators.scene.read import read_scene
    from ...operators.settings.groups import LightSettings
    from ...patchnet_addon.lightmap.charts import layout_charts
    from ...patchnet_addon.octree.grid import Grid
    from ...training.benchmarks.denoising import in_blocks

    depsgraph = bpy.context.evaluated_depsgraph_get()
    source = read_scene(depsgraph, "VISIBLE")
    texel = Grid.around(source.bounds_world, args.depth).voxel_size_world * args.texel_voxels
    light = LightSettings(samples=args.samples, daylight=not has_light(depsgraph))
    side = page_side(source.triangle_count)
    charts = yield from layout_charts(source, texel, samples=args.samples, page_side=side)
    everywhere = np.ones(source.triangle_count, bool)
    halves = yield from _baked(source, charts, light, 1, everywhere, args.keep)
    chosen = everywhere if args.share >= 1.0 else in_blocks(source, charts.texel_world, args.share)
    plain = yield from _baked(source, charts, replace(light, denoise=False), 1, chosen, args.keep)
    more = {}
    for samples in sorted(set(args.undenoised)):
        if samples > args.samples:
            larger = _with_paths(charts, args.samples, samples)
            more[samples] = yield from _baked(source, larger, replace(light, denoise=False), 1, chosen, args.keep)
    charts = _with_paths(charts, args.samples, args.reference_samples)
    reference = yield from _baked(source, charts, light, 2, chosen, args.keep)
    return Bakes(source, halves, plain, more, reference)


def _with_paths(charts: Charts, before: int, samples: int) -> Charts:
    """Charts with more paths and the same places: which triangles share paths depends on how many there are."""
    return replace(charts, page_samples=charts.page_samples * max(round(samples / before), 1))


def _baked(
    source: SceneMesh, charts: Charts, light: LightSettings, seed: int, chosen: np.ndarray, keep: Path | None
) -> Steps[Atlas]:
    """Atlas of the light of the triangles `chosen` (T,); pages are taken from a folder, and left."""
    import bpy

    from ...operators.cycles.bake.bake_key import bake_key, scene_key
    from ...operators.scene_access.blender_version import BAKE_SPREAD
    from ...patchnet_addon.lightmap.atlas import Atlas
    from ...patchnet_addon.lightmap.page_cache import BakePageCache

    baker, pages, kept = _part_baker(bpy.context, source, charts, light, seed, chosen), [], None
    if keep is not None:  # not as a block, which would delete the pages at its end
        kept = BakePageCache(keep)
        scene = scene_key(bpy.context.evaluated_depsgraph_get())
        kept.open(bake_key(scene, source, charts, light.samples, seed, (light, np.packbits(chosen).tobytes())))
    for page in range(charts.page_count):
        texels = kept.load(page, charts.page_side**2, baker.channels) if kept is not None else None
        if texels is None:
            texels = yield from baker.page(page)
            if kept is not None:
                kept.save(page, texels)
        pages.append(texels)
    texels = np.concatenate(pages)
    if not light.denoise:
        return Atlas(charts, texels, light.samples, baker.warnings, spread=BAKE_SPREAD)
    return Atlas(charts, texels[:, :-1], light.samples, baker.warnings, noise=texels[:, -1], spread=BAKE_SPREAD)


def _part_baker(
    context: bpy.types.Context,
    source: SceneMesh,
    charts: Charts,
    light: LightSettings,
    seed: int,
    chosen: np.ndarray,
) -> Any:
    """Baker of the triangles `chosen` (T,) alone, in the light of all."""
    from ...operators.cycles.bake.baker import Baker

    class PartBaker(Baker):
        def triangles(self, page: int) -> PageTriangles:
            part = super().triangles(page)
            return part.only(chosen[part.triangles])

    return PartBaker(context, source, charts, light, seed=seed)
