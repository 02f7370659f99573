# SPDX-License-Identifier: GPL-3.0-or-later
"""Bake the light of a surface, page of charts by page.

For each page, a mesh of its triangles is added to a copy of the scene, lifted off the surface by far less than a voxel
and invisible to all rays, so that it neither shadows nor reflects anything; Cycles computes the light that arrives on
it. Instances stay instances, and the page bounds the memory.

Sheets are baked on each side that gets light (`two_sided_surfaces`), closed surfaces on the side of their normals,
unless light falls on the inner side, too. Where voxels hold one luminance, it is that of the normals' side; of cut-outs
and translucent materials it is the mean of both sides, without a dark, enclosed one.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from functools import cache, partial
from typing import TYPE_CHECKING, NamedTuple

import bpy
import numpy as np

from ....patchnet_addon.lightmap.charts import Charts
from ....patchnet_addon.runtime.errors import SettingError
from ....patchnet_addon.runtime.progress import Progress, Steps
from ....patchnet_addon.runtime.source_hash import source_hash
from ....patchnet_addon.runtime.worker import run_in_worker
from ....patchnet_addon.tracing.camera import Camera
from ....patchnet_addon.tracing.empty_view import BLACK_VIEWS
from ...scene.fingerprint import surface_hash
from ...scene.scene_mesh import SceneMesh
from ...scene_access.blender_version import BAKE_SPREAD
from ...scene_access.devices import bakes_on_gpu
from ...schema.table import AUTO
from ...settings.groups import LightSettings
from ...state.digest import Digest, composed
from ...state.watch import check_unchanged
from .baker import Baker, lift_world
from .side_probe import black_views
from .two_sided_surfaces import plan_sides

if TYPE_CHECKING:  # it brings numba, which nothing imports before it computes
    from ....patchnet_addon.lightmap.atlas import Atlas
    from ....patchnet_addon.lightmap.page_cache import BakePageCache

MAX_TEXELS = 1 << 25
# Triangles up to which pages have this side. Each bake call reads the whole scene, so large scenes have few pages; many
# pages give finer progress and take less memory.
_PAGE_SIDES = ((200_000, 512), (1_000_000, 1024), (np.inf, 2048))
_SIDES = tuple(str(1 << log_side) for log_side in range(13))
_CHART_ARRAYS = (
    "page", "x", "y", "log_width", "log_height", "kind", "origin", "along", "page_samples", "page_size"
)  # fmt: skip
_code_hash = cache(lambda: source_hash("operators.cycles.bake.bake"))  # with its imports


class KeptPages(NamedTuple):
    """Cache of the finished pages of a bake, and the identity of the scene's state."""

    pages: BakePageCache
    state: str


def bake_luminance(
    context: bpy.types.Context,
    source: SceneMesh,
    texel_world: float | np.ndarray,
    light: LightSettings,
    *,
    seed: int = 0,
    device: str = AUTO,
    kept: KeptPages | None = None,
    cameras: Sequence[Camera] = (),
) -> Steps[Atlas]:
    """Diffuse light with global illumination, and emission, on all triangles of `source`.

    texel_world: side of a texel, about that of a leaf, one for all or (T,); texels grow if there would be more than
    MAX_TEXELS.
    light: `samples` are paths per texel and side; `denoise` adds noise estimates to the atlas, `color` colour
    (`Atlas.texels`); without sides, opaque sheets are baked on one side; `gloss` selects the materials whose
    reflections are baked; `daylight` replaces the scene's world by our sun and sky.
    device: one of `DEVICES`; automatic is a GPU if the preferences of Cycles enable one.
    kept: cache of finished pages.
    cameras: closed surfaces that they see from within may be lit there (methods 7.2f).
    Raises SceneError if Cycles is missing or cannot bake, SettingError for a GPU that is not enabled.
    """
    from ....patchnet_addon.lightmap.charts import layout_charts

    side = page_side(source.triangle_count)
    laid_out = partial(layout_charts, source, texel_world, samples=light.samples, max_texels=MAX_TEXELS, page_side=side)
    charts = yield from run_in_worker(laid_out, Progress(0, 1, "Laying out charts"))
    lift = lift_world(source, charts)
    plan = yield from plan_sides(context, source, cameras, light, lift)
    switches: tuple[object, ...] = (light.color, light.denoise, bakes_on_gpu(context, device), bool(light.daylight))
    switches += light.gloss, plan.facing.tobytes(), plan.is_behind.tobytes()
    if light.from_camera and context.scene.camera is not None:
        switches += tuple(map(tuple, context.scene.camera.matrix_world))
    baker = Baker(context, source, charts, light, plan, seed=seed, device=device)
    key = "" if kept is None else bake_key(kept.state, source, charts, light.samples, seed, switches)
    sides = yield from _pages(baker, charts, None if kept is None else kept.pages, key)
    front, back = (_atlas(charts, texels, light) for texels in sides)
    atlas = replace(front, warnings=(*baker.warnings, *_coarse(charts)))
    # In a voxel with sides, a side that is not baked is black, even if no back is baked.
    facing = np.where((plan.pieces < 0) & light.has_sides, np.int8(0), baker.lit)
    if (facing <= 0).any():
        atlas = replace(atlas, back=back, lit=baker.lit, facing=facing, back_share=baker.back_share)
    if black := (yield from black_views(context, source, atlas, plan.sight, light, lift)):
        atlas.notes[BLACK_VIEWS] = black
    return atlas


def _atlas(charts: Charts, texels: np.ndarray, light: LightSettings) -> Atlas:
    """Atlas of one side."""
    from ....patchnet_addon.lightmap.atlas import Atlas

    noise, lit = (texels[:, -1], texels[:, :-1]) if light.denoise else (None, texels)
    return Atlas(charts, lit, light.samples, noise=noise, spread=BAKE_SPREAD)


def bake_key(
    state: str, source: SceneMesh, charts: Charts, samples: int, seed: int, switches: tuple[object, ...] = ()
) -> str:
    """32 hex digits over everything that determines the pages of a bake, so that equal keys mean equal bits.

    state: identity of the scene's state. switches: all other settings of the bake.
    """
    layout = Digest()
    layout.struct(bpy.context.scene.cycles)  # also what changes bits alone, such as the sampling pattern
    layout.text(charts.texel_world, charts.page_side, charts.page_count)
    for name in _CHART_ARRAYS:
        layout.array(name, getattr(charts, name))
    blender = bpy.app.version_string, bpy.app.build_hash, _devices()
    parts = state, surface_hash(source), layout.hexdigest()
    return composed(_code_hash(), *blender, *parts, samples, seed, switches)


def _devices() -> tuple[str, ...]:
    """Devices of Cycles, whose results differ in their last bits."""
    try:
        import _cycles  # type: ignore[import-not-found]
    except ImportError:
        return ()
    return tuple(str(device[:2]) for device in _cycles.available_devices("NONE"))


def _pages(baker: Baker, charts: Charts, kept: BakePageCache | None, key: str) -> Steps[tuple[np.ndarray, ...]]:
    """Texels (pages * side * side, C) of fronts and backs; pages in the cache are not baked again."""
    count, channels = charts.page_side**2, baker.channels
    sides = tuple(np.zeros((charts.page_count, count, channels), np.float32) for _ in range(2))
    if kept is not None:
        yield Progress(0, 1, "Looking for finished pages")
        kept.open(key)
        if there := len(kept.pages()):
            yield Progress(there, charts.page_count, f"Resuming: {there} of {charts.page_count} pages are there")
    for page in range(charts.page_count):
        mine = charts.page == page
        finished = kept.load(page) if kept is not None else None
        if finished is not None:
            texels, baker.lit[mine], baker.back_share[mine] = finished
        else:
            texels = np.stack((yield from baker.page(page)))
            check_unchanged()  # the cache must not get a page of a changed scene
            if kept is not None:
                kept.save(page, texels, baker.lit[mine], baker.back_share[mine])
        for side, of_page in zip(sides, texels, strict=True):
            if of_page.any():  # untouched pages take no memory
                side[page] = of_page
    yield Progress(charts.page_count, charts.page_count, "Baking light")
    return tuple(side.reshape(-1, channels) for side in sides)


def page_side(triangle_count: int) -> int:
    """Side of the pages of a surface in texels; PATCHNET_PAGE_SIDE, a power of two up to 4096, makes it another one."""
    if text := os.environ.get("PATCHNET_PAGE_SIDE"):
        if text not in _SIDES:
            raise SettingError(f"PATCHNET_PAGE_SIDE is {text!r}: set it to one of {', '.join(_SIDES)}, or unset it")
        return int(text)
    return next(side for limit, side in _PAGE_SIDES if triangle_count <= limit)


def _coarse(charts: Charts) -> tuple[str, ...]:
    if charts.growth < 1.01:
        return ()
    return (
        f"The light is baked with texels {charts.growth:.1f} times as large as asked for, since there would be more "
        f"than {MAX_TEXELS / 1e6:.0f} million: choose a smaller depth or fewer objects for finer light",
    )
