# SPDX-License-Identifier: GPL-3.0-or-later
"""Baking the light of a surface, page of charts by page.

The scene stays as it is: nothing in it is hidden. For each page a mesh of its triangles is added, lifted off the
surface by far less than a voxel and invisible to all rays, so that it neither shadows nor reflects anything; Cycles
computes the light that arrives on it. So instances stay instances, and memory is bounded by the page. Between two
pages the scene is exactly as before.

Both sides of sheets are baked. Closed surfaces, whose inner side nobody sees, only from outside. A side that gets next
to no light beside the other does not count: it is enclosed, although the surface has a gap.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

import bpy
import numpy as np

from ...patchnet_addon.errors import SceneError, SettingError
from ...patchnet_addon.light.charts import Charts
from ...patchnet_addon.progress import Progress, Steps
from ..scene.scene_mesh import SceneMesh
from ..window_job import when_job_ended, window_is_alive
from .bake_call import run as _run
from .bake_call import run_as_job
from .bake_key import bake_key
from .bake_materials import bake_materials
from .closed_runs import ClosedPieces
from .devices import gpu_is_enabled
from .object_data import attributes_needed, lost_inputs
from .page_mesh import PageTriangles, fill_mesh, joined, page_triangles
from .settings import changed, object_mode

if TYPE_CHECKING:  # it brings numba, which nothing imports before it computes
    from ...patchnet_addon.light.atlas import Atlas
    from ...patchnet_addon.light.kept_pages import KeptPages

MAX_TEXELS = 1 << 25
# Triangles up to which pages have this side: a bake starts with reading the whole scene into Cycles, so that large
# scenes want few pages, small ones many: for reports of progress, and for memory.
_PAGE_SIDES = ((200_000, 512), (1_000_000, 1024), (np.inf, 2048))
_SIDES = tuple(str(1 << log_side) for log_side in range(13))
_DARK_SIDE = 0.02  # of the brighter side: enclosed
# Side of what Cycles samples at a time, in texels. It hears of a stop between two passes over a tile only, and a pass
# over a whole page takes a processor many seconds. The bits are the same.
_TILE_SIDE = 256
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)


def bake_luminance(
    context: bpy.types.Context,
    source: SceneMesh,
    texel_world: float | np.ndarray,
    samples: int,
    seed: int = 0,
    *,
    max_texels: int = MAX_TEXELS,
    kept: KeptPages | None = None,
) -> Steps[Atlas]:
    """Diffuse light with global illumination, and emission, on all triangles of `source`.

    texel_world: side of a texel, about that of a leaf, one for all or (T,); texels grow if there would be more than
    `max_texels`.
    samples: paths a texel and side. kept: finished pages are taken from there and left there.
    Raises SceneError if Cycles is not there or cannot bake.
    """
    from ...patchnet_addon.light.atlas import Atlas
    from ...patchnet_addon.light.charts import layout_charts

    if samples < 1:
        raise SettingError(f"{samples} samples per texel are too few: choose at least 1")
    side = page_side(source.triangle_count)
    charts = yield from layout_charts(source, texel_world, samples=samples, max_texels=max_texels, page_side=side)
    baker = _Baker(context, source, charts, seed)
    pages = np.zeros((charts.page_count, charts.page_side**2, 2), np.float32)
    if kept is not None:
        yield Progress(0, 1, "Looking for finished pages")
        kept.open(bake_key(context, source, charts, samples, seed))
        if there := len(kept.pages()):
            yield Progress(there, charts.page_count, f"Resuming: {there} of {charts.page_count} pages are there")
    for page in range(charts.page_count):
        finished = kept.load(page, charts.page_side**2) if kept is not None else None
        if finished is None:
            pages[page] = yield from baker.page(page)
            if kept is not None:
                kept.save(page, pages[page])
        else:
            pages[page] = finished
    yield Progress(charts.page_count, charts.page_count, "Baking light")
    return Atlas(charts, pages.reshape(-1, 2), samples, (*baker.warnings, *_coarse(charts, max_texels)))


def page_side(triangle_count: int) -> int:
    """Side of the pages of a surface in texels; PATCHNET_PAGE_SIDE, a power of two up to 4096, makes it another one."""
    if text := os.environ.get("PATCHNET_PAGE_SIDE"):
        if text not in _SIDES:
            raise SettingError(f"PATCHNET_PAGE_SIDE is {text!r}: make it one of {', '.join(_SIDES)}, or unset it")
        return int(text)
    return next(side for limit, side in _PAGE_SIDES if triangle_count <= limit)


class _Baker:
    """Bakes sides of pages; holds nothing of Blender's between two calls but the context."""

    def __init__(self, context: bpy.types.Context, source: SceneMesh, charts: Charts, seed: int) -> None:
        self._context = context
        self._source = source
        self._charts = charts
        self._seed = seed
        self._closed = ClosedPieces()
        used = [material for material in bpy.data.materials if material.name_full in source.material_names]
        self._attributes = attributes_needed(used)
        self.warnings = tuple(_lost(material.name, nodes) for material in used if (nodes := lost_inputs(material)))
        # Far less than a voxel, but well above the rounding of single precision coordinates.
        reach = float(np.abs(source.bounds_world).max())
        self._offset_world = max(1e-3 * charts.texel_world, 2.0**-18 * reach)

    def page(self, page: int) -> Steps[np.ndarray]:
        """The texels (side * side, 2) of a page."""
        count = self._charts.page_count
        at = Progress(page, count, "Baking light")
        yield at
        part = self.triangles(page)
        if len(part) == 0:
            return np.zeros((self._charts.page_side**2, 2), np.float32)
        sheets = part.only(~part.closed)
        front, back = yield from self.bake(page, part, sheets, at)
        texels = self.merged(page, sheets.triangles, front, back)
        lit_inside = part.only(self.black(page, part, front))
        if len(lit_inside):
            at = replace(at, done=page + 0.5)
            yield at
            _, back = yield from self.bake(page, part.only(np.zeros(len(part), bool)), lit_inside, at)
            texels = self.merged(page, lit_inside.triangles, texels, back)
        return texels

    def triangles(self, page: int) -> PageTriangles:
        """What lies on a page."""
        return page_triangles(self._source, self._charts, page, self._closed, self._attributes)

    def black(self, page: int, part: PageTriangles, front: np.ndarray) -> np.ndarray:
        """(N,) bool: closed triangles that get no light from outside; a lamp may be inside."""
        from ...patchnet_addon.light.chart_lookup import group_means

        means = group_means(self._charts, front, part.triangles, page)[:, 0]
        return part.closed & (means <= 1e-6 * means.max(initial=0.0))

    def merged(self, page: int, triangles: np.ndarray, front: np.ndarray, back: np.ndarray) -> np.ndarray:
        """The page (side * side, 2) with both sides of `triangles` averaged, or the lit one where the other is dark."""
        from ...patchnet_addon.light.chart_lookup import group_means, texel_owners

        means = [group_means(self._charts, side, triangles, page)[:, 0] for side in (front, back)]
        weight = np.full(len(triangles), 0.5, np.float32)  # of the back
        weight[means[1] <= _DARK_SIDE * means[0]] = 0.0
        weight[means[0] < _DARK_SIDE * means[1]] = 1.0
        of_triangle = np.zeros(len(self._charts.page) + 1, np.float32)  # the last one: texels without a triangle
        of_triangle[triangles] = weight
        of_texel = of_triangle[texel_owners(self._charts, page)][:, None]
        return front * (1.0 - of_texel) + back * of_texel

    def bake(self, page: int, fronts: PageTriangles, backs: PageTriangles, at: Progress) -> Steps[list[np.ndarray]]:
        """Both sides of a page, each (side * side, 2) float32: luminance weighed by opacity, and opacity; else zero.

        In a window, what is baked stays in the scene while steps wait; reports are `at`.
        """
        names = self._source.material_names
        samples, size = int(self._charts.page_samples[page]), self._charts.page_size[page]
        stack = ExitStack()
        try:
            stack.enter_context(object_mode(self._context))
            stack.enter_context(_cycles(self._context, samples, self._seed))
            images, materials = [], []
            for part, back in ((fronts, False), (backs, True)):
                images.append(stack.enter_context(_image(size)) if len(part) else None)
                materials += stack.enter_context(bake_materials(names if len(part) else (), images[-1], back))
            mesh = stack.enter_context(_mesh())
            shift = len(names) if len(fronts) else 0
            fill_mesh(mesh, joined([fronts, backs.turned(shift)]), materials, self._offset_world)
            target = stack.enter_context(_target(self._context, mesh))
            if window_is_alive():
                target.hide_set(True)  # from the person's eyes, not from the bake
                yield from run_as_job(self._context, target, [image for image in images if image], at)
            else:
                _run(self._context, target)
            return [_shine(image, self._charts.page_side) for image in images]
        finally:
            when_job_ended(stack.close)


def _shine(image: bpy.types.Image | None, side: int) -> np.ndarray:
    """Luminance times opacity, and opacity (side * side, 2) float32 of a page whose lower left is a baked image."""
    page = np.zeros((side, side, 2), np.float32)
    if image is None:
        return page.reshape(-1, 2)
    width, height = image.size
    pixels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(pixels)
    pixels = np.nan_to_num(pixels.reshape(height, width, 4), posinf=0.0, neginf=0.0)
    page[:height, :width, 0] = np.maximum(pixels[..., :3] @ _LUMINANCE, 0.0)
    page[:height, :width, 1] = np.clip(pixels[..., 3], 0.0, 1.0)
    return page.reshape(-1, 2)


def _coarse(charts: Charts, max_texels: int) -> tuple[str, ...]:
    if charts.growth < 1.01:
        return ()
    return (
        f"The light is baked with texels {charts.growth:.1f} times as large as asked for, since there would be more "
        f"than {max_texels / 1e6:.0f} million: choose a smaller depth or fewer objects for finer light",
    )


def _lost(name: str, nodes: tuple[str, ...]) -> str:
    listed = ", ".join(f"'{node}'" for node in nodes)
    return f"Material '{name}' is baked without what depends on the view or on whole objects: node {listed}"


@contextmanager
def _cycles(context: bpy.types.Context, samples: int, seed: int) -> Iterator[None]:
    """Settings for an unbiased bake, on GPUs where they are enabled; the user's bounces and light stay."""
    scene = context.scene
    if not hasattr(scene, "cycles"):
        raise SceneError("The Cycles render engine is disabled: enable its add-on, or choose the two-lights shading")
    on_gpu = gpu_is_enabled(context)
    with ExitStack() as stack:
        stack.enter_context(changed(scene.render, engine="CYCLES"))
        if not on_gpu:  # a GPU wants large tiles, and is done with them soon
            stack.enter_context(changed(scene.cycles, use_auto_tile=True, tile_size=_TILE_SIDE))
        stack.enter_context(
            changed(
                scene.cycles,
                samples=samples,
                seed=seed,
                device="GPU" if on_gpu else scene.cycles.device,
                use_animated_seed=False,
                use_adaptive_sampling=False,
                use_denoising=False,
                sample_clamp_direct=0.0,
                sample_clamp_indirect=0.0,
                film_exposure=1.0,
                time_limit=0.0,
                use_sample_subset=False,
            )
        )
        yield


@contextmanager
def _image(size: np.ndarray) -> Iterator[bpy.types.Image]:
    width, height = (int(texels) for texels in size)
    image = bpy.data.images.new("PatchNet Bake", width, height, alpha=True, float_buffer=True, is_data=True)
    try:
        yield image
    finally:
        bpy.data.images.remove(image)


@contextmanager
def _mesh() -> Iterator[bpy.types.Mesh]:
    mesh = bpy.data.meshes.new("PatchNet Bake")
    try:
        yield mesh
    finally:
        bpy.data.meshes.remove(mesh)


@contextmanager
def _target(context: bpy.types.Context, mesh: bpy.types.Mesh) -> Iterator[bpy.types.Object]:
    """An object of `mesh` that no ray meets, removed after the block."""
    item = bpy.data.objects.new("PatchNet Bake", mesh)
    try:
        context.scene.collection.objects.link(item)
        # Cycles drops objects that no ray at all can meet: scattering in volumes is what remains.
        for ray in ("camera", "diffuse", "glossy", "transmission", "shadow"):
            setattr(item, f"visible_{ray}", False)
        context.view_layer.update()
        yield item
    finally:
        bpy.data.objects.remove(item)
