# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles bake of one page of charts, with both sides of its surface."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import NamedTuple

import bpy
import numpy as np

from ....patchnet_addon.lightmap.charts import Charts
from ....patchnet_addon.runtime.progress import Progress, Steps
from ....patchnet_addon.runtime.worker import computed
from ....patchnet_addon.surface.chroma import REC709
from ...scene.light_links import Links
from ...scene.precision import LIFT_SHARE
from ...scene.scene_mesh import SceneMesh
from ...scene_access.devices import bakes_on_gpu
from ...scene_access.temporary import temporary
from ...scene_access.window_job import window_is_alive
from ...schema.table import AUTO
from ...settings.groups import LightSettings
from ..daylight import emits
from .bake_call import BakeTarget, bake_as_job, bake_now
from .bake_materials import bake_materials
from .bake_scene import bake_scene, lit_as, most_paths, page_image, page_object, set_cycles
from .gloss_passes import baked_with_gloss, gloss_warnings
from .object_data import lost_inputs, needs_coordinates
from .one_sided import materials_that, one_sided_materials, shows, translucent_materials
from .page_mesh import PageTriangles, fill_mesh, joined, page_triangles
from .two_sided_surfaces import SidePlan

_MOST_LOST = 12  # nodes in a sentence
_MOST_TRIANGLES = 1 << 22  # a call
_DARK_SIDE = 0.02  # of the brighter side: enclosed
_DARK_PIECE = 1e-3  # of the brightest triangle on a page: next to no light


class _Passes(NamedTuple):
    """Passes of one bake: through: only translucent light from behind, or all but that. gloss: with it or without."""

    through: bool
    gloss: bool


_DIFFUSE, _GLOSSY, _THROUGH = _Passes(False, False), _Passes(False, True), _Passes(True, False)


class Baker:
    """Baker of the sides of pages; between two calls it holds no data of Blender but the context.

    plan: sides of triangles to bake. channels: of texels, 2, or 4 with colour, see `Atlas`; with `denoise`, one more
    for the noise, half the difference of two halves of the paths. warnings: sentences about inputs that cannot be
    baked. paths_traced: number of paths of the last page.
    """

    def __init__(
        self,
        context: bpy.types.Context,
        source: SceneMesh,
        charts: Charts,
        light: LightSettings,
        plan: SidePlan,
        *,
        seed: int = 0,
        device: str = AUTO,
    ) -> None:
        """Prepare for `device`, one of `DEVICES`; raises SettingError for a GPU that is not there."""
        from ....patchnet_addon.lightmap.atlas import COLOR_CHANNELS

        self._context, self._source, self._charts, self._seed = context, source, charts, seed
        self.channels = (COLOR_CHANNELS if light.color else 2) + bool(light.denoise)
        self._on_gpu = bakes_on_gpu(context, device)
        self._light, self._with_gloss = light, baked_with_gloss(source, light.gloss)
        self._shown = np.array([shows(material) for material in source.materials])
        used = [material for material in bpy.data.materials if material.name_full in source.material_names]
        self._needs_coordinates = needs_coordinates(used)
        self._translucent, self._one_sided = translucent_materials(source), one_sided_materials(source)
        self._shining = materials_that(emits, source)
        self._plan, self._pieces, self.lit = plan, plan.pieces, plan.facing.copy()
        self.back_share = (plan.facing < 0).astype(np.float32)
        self.paths_traced = 0
        transformed = source.turned_materials
        lost = [
            f"node '{node}' of material '{material.name}'"
            for material in used
            for node in lost_inputs(material, material.name_full in transformed, charts.page_count > 1)
        ]
        self.warnings = (*_lost(lost), *gloss_warnings(source, light))
        self._offset_world = lift_world(source, charts)

    def page(self, page: int) -> Steps[list[np.ndarray]]:
        """Texels (side * side, C) of a page, of fronts and of backs."""
        count, self.paths_traced = self._charts.page_count, 0
        at = Progress(page, count, "Baking light")
        part = yield from computed(lambda: self.triangles(page), at)
        if len(part) == 0:
            return [np.zeros((self._charts.page_side**2, self.channels), np.float32)] * 2
        yield at
        facing = self.lit[part.triangles]
        sides = yield from self.bake(page, part.only(facing >= 0), part.only(facing <= 0), at)
        yield from computed(lambda: self._weigh(page, part.only(facing == 0), sides), at)
        dark = yield from computed(lambda: part.only((facing > 0) & self.black(page, part, sides[0])), at)
        if len(dark):
            at = replace(at, done=page + 0.5)
            yield at
            _, back = yield from self.bake(page, part.only(np.zeros(len(part), bool)), dark, at)
            sides[1] += back
            yield from computed(lambda: self._turn(page, dark.triangles, sides), at)
        return sides

    def triangles(self, page: int) -> PageTriangles:
        """Triangles on a page that are not transparent."""
        part = page_triangles(self._source, self._charts, page, self._pieces, self._needs_coordinates)
        return part.only(self._shown[part.materials])

    def black(self, page: int, part: PageTriangles, front: np.ndarray) -> np.ndarray:
        """(N,) bool: triangles of closed pieces that get next to no light, although some may enter at an edge.

        A lamp may be inside, or normals may be flipped.
        """
        from ....patchnet_addon.lightmap.chart_lookup import group_means
        from ....patchnet_addon.octree.voxelize import triangle_areas_and_normals

        means = group_means(self._charts, front, part.triangles, page)[:, 0]
        brightest = float(means.max(initial=0.0))
        number = np.unique(part.pieces, return_inverse=True)[1].reshape(-1)
        area, _ = triangle_areas_and_normals(part.corners_world)
        light, whole = np.bincount(number, area * means), np.bincount(number, area)
        return np.asarray(part.closed & (light <= _DARK_PIECE * brightest * whole)[number])

    def _weigh(self, page: int, sheets: PageTriangles, sides: Sequence[np.ndarray]) -> None:
        """Set the share of backs in the one luminance of sheets that are baked on both sides.

        0 for materials with one side, unless cameras see only the back; 0.5 for others; a dark side counts 0. Dark
        backs of sheets that were not measured are dropped.
        """
        front, back = self._means(page, sheets.triangles, sides)
        two_sided, dark = ~self._one_sided[sheets.materials], back <= _DARK_SIDE * front
        is_behind, is_measured = (of[sheets.triangles] for of in (self._plan.is_behind, self._plan.is_measured))
        share = np.where(two_sided, np.float32(0.5), np.where(is_behind, np.float32(1.0), np.float32(0.0)))
        share[dark] = 0.0
        share[(front < _DARK_SIDE * back) & (two_sided | self._shining[sheets.materials])] = 1.0
        self.back_share[sheets.triangles] = share
        self.lit[sheets.triangles] = np.where(dark & ~two_sided & ~is_measured, 1, 0)

    def _turn(self, page: int, triangles: np.ndarray, sides: Sequence[np.ndarray]) -> None:
        """Show the backs of triangles of closed pieces if only these get light."""
        front, back = self._means(page, triangles, sides)
        turned = triangles[front < _DARK_SIDE * back]
        self.lit[turned], self.back_share[turned] = -1, 1.0

    def _means(self, page: int, triangles: np.ndarray, sides: Sequence[np.ndarray]) -> list[np.ndarray]:
        from ....patchnet_addon.lightmap.chart_lookup import group_means

        return [group_means(self._charts, side, triangles, page)[:, 0] for side in sides]

    def _on_texels(self, page: int, triangles: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Values (N,) of triangles on the texels (side * side,) of a page that belong to them; zero elsewhere."""
        from ....patchnet_addon.lightmap.chart_lookup import texel_owners

        of_triangle = np.zeros(len(self._charts.page) + 1, values.dtype)  # last: texels without a triangle
        of_triangle[triangles] = values
        result: np.ndarray = of_triangle[texel_owners(self._charts, page)]
        return result

    def bake(self, page: int, fronts: PageTriangles, backs: PageTriangles, at: Progress) -> Steps[list[np.ndarray]]:
        """Bake both sides of a page, (side * side, C) float32 each: luminance weighted by opacity, and opacity; else 0.

        With colour, also red and blue weighted by opacity. Objects with different light links, translucent light and
        gloss are baked in calls of their own.
        """
        sides = [np.zeros((self._charts.page_side**2, self.channels), np.float32) for _ in range(2)]
        for number in np.unique(np.concatenate([fronts.links, backs.links])):
            links = self._source.light_links[number]
            linked = [part.only(part.links == number) for part in (fronts, backs)]
            for what in (_DIFFUSE, _GLOSSY, _THROUGH):
                chosen = self._translucent if what.through else self._with_gloss == what.gloss
                front, back = (part.only(chosen[part.materials]) for part in linked)
                for fronts_now, backs_now in self._calls(page, front, back):
                    baked = yield from self._bake(page, fronts_now, backs_now, links, what, at)
                    for index, side in enumerate(baked):
                        if what.through:
                            side[:, 1] = 0.0  # opacity counts once
                        sides[index] += side
        return sides

    def _calls(
        self, page: int, fronts: PageTriangles, backs: PageTriangles
    ) -> Iterator[tuple[PageTriangles, PageTriangles]]:
        """Divide the triangles of a page into calls of at most `most_paths` paths and _MOST_TRIANGLES triangles.

        Blender and Cycles hold copies of all triangles of a call.
        """
        from ....patchnet_addon.lightmap.chart_lookup import texel_owners

        texels = np.bincount(texel_owners(self._charts, page) + 1, minlength=len(self._charts.page) + 1)[1:]
        triangles = np.concatenate([fronts.triangles, backs.triangles])
        paths = texels[triangles] * int(self._charts.page_samples[page]) / most_paths(self._source.triangle_count)
        copies = (2 if self._light.denoise else 1) / _MOST_TRIANGLES
        call = np.floor(np.cumsum(np.maximum(paths, copies))).astype(np.int64)
        for number in np.unique(call):
            now = call == number
            yield fronts.only(now[: len(fronts)]), backs.only(now[len(fronts) :])

    def _bake(
        self, page: int, fronts: PageTriangles, backs: PageTriangles, links: Links, what: _Passes, at: Progress
    ) -> Steps[list[np.ndarray]]:
        """Bake, as `bake` does, some passes of objects with equal light links; reports are `at`."""
        names = self._source.material_names
        samples, size = int(self._charts.page_samples[page]), self._charts.page_size[page]
        halves = min(2 if self._light.denoise else 1, samples)  # what has one path is baked once
        samples = -(-samples // halves)
        owned = yield from computed(
            lambda: [self._on_texels(page, part.triangles, np.ones(len(part), bool)) for part in (fronts, backs)], at
        )
        self.paths_traced += samples * halves * sum(int(np.count_nonzero(own)) for own in owned)
        with ExitStack() as stack:
            scene, layer = stack.enter_context(bake_scene(self._context, with_daylight=bool(self._light.daylight)))
            set_cycles(scene, samples, self._seed, self._on_gpu, skips_centers=halves > 1)
            from_camera = self._light.from_camera and scene.camera is not None
            scene.render.bake.view_from = "ACTIVE_CAMERA" if from_camera else "ABOVE_SURFACE"
            sides = (len(fronts) > 0) + (len(backs) > 0)
            image = stack.enter_context(page_image(size, sides * halves))  # one: Cycles reads the scene for each
            materials, parts = [], []
            oblique = not self._light.from_camera
            for part, back in ((fronts, False), (backs, True)):
                used, mine = np.unique(part.materials, return_inverse=True)
                part = replace(part, materials=mine.reshape(-1).astype(np.int32))
                first = halves if back and sides == 2 else 0
                parts.append(joined([part.on_image(sides * halves, first + half) for half in range(halves)]))
                own = [names[number] for number in used]
                materials.append(stack.enter_context(bake_materials(own, image, back, what.through, oblique=oblique)))
            mesh = stack.enter_context(temporary(bpy.data.meshes.new("PatchNet Bake")))
            lift_world = -self._offset_world if what.through else self._offset_world
            turned = parts[1].turned(len(materials[0]))
            fill_mesh(mesh, joined([parts[0], turned]), [*materials[0], *materials[1]], lift_world)
            item = stack.enter_context(page_object(scene, mesh))
            stack.enter_context(lit_as(item, links))
            target = BakeTarget(scene, scene.view_layers[layer], item, image, what.gloss)
            if window_is_alive():
                yield from bake_as_job(self._context, target, at)
            else:
                bake_now(self._context, target)
            baked = _shine(image, int(size[1]), self._charts.page_side, 4 if self._light.color else 2)
            lit = [self._merged_halves(baked[first : first + halves]) for first in range(0, len(baked), halves)]
            # Blender 5.3 also bakes texels that a triangle only touches, which belong to other calls.
            return [side * own[:, None] for side, own in zip((lit[0], lit[-1]), owned, strict=True)]

    def _merged_halves(self, halves: Sequence[np.ndarray]) -> np.ndarray:
        """Mean (side * side, C) of one or two halves of the paths, with the noise if it is wanted.

        The noise of a single path is unknown, and taken to be as large as the light.
        """
        mean: np.ndarray = np.mean(halves, axis=0, dtype=np.float32)
        if not self._light.denoise:
            return mean
        noise = (halves[0][:, 0] - halves[-1][:, 0]) / 2.0 if len(halves) > 1 else mean[:, 0]
        return np.column_stack([mean, noise])


def _shine(image: bpy.types.Image, height: int, side: int, channels: int) -> list[np.ndarray]:
    """Texels (side * side, channels) float32 of the pages that lie above each other on a baked image."""
    width, rows = image.size
    pixels = np.empty(width * rows * 4, np.float32)
    image.pixels.foreach_get(pixels)
    pixels = np.nan_to_num(pixels.reshape(-1, height, width, 4), posinf=0.0, neginf=0.0)
    pages = np.zeros((len(pixels), side, side, channels), np.float32)
    pages[:, :height, :width, 0] = np.maximum(pixels[..., :3] @ REC709, 0.0)
    pages[:, :height, :width, 1] = np.clip(pixels[..., 3], 0.0, 1.0)
    if channels > 2:
        pages[:, :height, :width, 2:] = np.maximum(pixels[..., (0, 2)], 0.0)
    return list(pages.reshape(len(pages), -1, channels))


def lift_world(source: SceneMesh, charts: Charts) -> float:
    """Distance off the surface at which light is baked: far below a voxel, far above the rounding of coordinates."""
    return max(1e-3 * charts.texel_world, LIFT_SHARE * float(np.abs(source.bounds_world).max()))


def _lost(nodes: Sequence[str]) -> tuple[str, ...]:
    """Sentence that names nodes that a bake cannot evaluate, if there are any."""
    if not nodes:
        return ()
    more = f" and {len(nodes) - _MOST_LOST} more" if len(nodes) > _MOST_LOST else ""
    return (f"What depends on the view or on whole objects is not baked: {', '.join(nodes[:_MOST_LOST])}{more}",)
