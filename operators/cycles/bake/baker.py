# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles bake of surfels: a small triangle with a texel of its own for each, lifted off the surface and seen by no ray.

Objects with different light links, translucent light and gloss are baked in calls of their own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import NamedTuple

import bpy
import numpy as np

from ....patchnet_addon.runtime.omissions import Omissions
from ....patchnet_addon.runtime.progress import Progress, Steps
from ....patchnet_addon.runtime.worker import computed
from ....patchnet_addon.surface.chroma import REC709
from ....patchnet_addon.surface.scene_mesh import Links, SceneMesh
from ...scene.precision import LIFT_SHARE
from ...scene_access.devices import bakes_on_gpu
from ...scene_access.temporary import temporary
from ...scene_access.window_job import window_is_alive
from ...schema.values import AUTO
from ...settings.groups import LightSettings
from .bake_call import BakeTarget, bake_as_job, bake_now
from .bake_materials import bake_materials
from .bake_scene import bake_image, bake_object, bake_scene, lit_as, most_paths, set_cycles
from .baked_colors import color_is_baked
from .gloss_passes import REFINE, baked_with_gloss, gloss_warnings
from .mean_view import nodes_by_view
from .object_data import lost_inputs, needs_coordinates
from .one_sided import shows, translucent_materials
from .surfel_mesh import BLOCK, PARTS, SurfelTriangles, fill_mesh, surfel_triangles

_MOST_NAMED = 12  # nodes in a sentence
_BY_VIEW = (
    "Diffuse roughness and sheen are baked as the mean of all views: {}: choose Gloss: From Camera for one view, or "
    f"{REFINE}"
)
_MOST_TRIANGLES = 1 << 22  # a call
_LIFT_SHARE = 2e-6  # of the octree's cube
_LEAST_COLOR = 1e-3  # of a baked base color: Cycles ends paths on darker ones


class _Passes(NamedTuple):
    """Passes of one bake: through: only translucent light from behind, or all but that. gloss: with it or without.

    colors: colours instead of light.
    """

    through: bool = False
    gloss: bool = False
    colors: bool = False


_DIFFUSE, _GLOSSY, _THROUGH, _COLORS = _Passes(), _Passes(gloss=True), _Passes(through=True), _Passes(colors=True)


class SurfelBaker:
    """Baker of surfels; between two calls it holds no data of Blender but the context.

    channels: of baked light: luminance, with colour red, green and blue, all times opacity, opacity, and half the
    difference of luminance times opacity in its two texels. paths_traced: so far.
    """

    def __init__(
        self,
        context: bpy.types.Context,
        source: SceneMesh,
        light: LightSettings,
        side_world: float,
        *,
        device: str = AUTO,
    ) -> None:
        """Prepare for `device`, AUTO, CPU or GPU; raises SettingError for a GPU that is not there.

        side_world: of the octree's cube.
        """
        self._context, self._source, self._light = context, source, light
        self.channels = 6 if light.color else 3
        self._on_gpu = bakes_on_gpu(context, device)
        self._with_gloss = baked_with_gloss(source, light.gloss)
        self._color_is_baked = color_is_baked(source, light.gloss)
        self._shines = np.array([max(material.emission) > 0.0 for material in source.materials], bool)
        self._shown = np.array([shows(material) for material in source.materials])
        used = [material for material in bpy.data.materials if material.name_full in source.material_names]
        self._needs_coordinates = needs_coordinates(used)
        self._translucent = translucent_materials(source)
        self.paths_traced = 0
        transformed = source.turned_materials
        lost = [
            f"node '{node}' of material '{material.name}'"
            for material in used
            for node in lost_inputs(material, material.name_full in transformed)
        ]
        by_view = [f"node '{node}' of material '{item.name}'" for item in used for node in nodes_by_view(item)]
        self._unread = Omissions()
        self._warnings = (
            *_named("What depends on the view or on whole objects is not baked: {}", lost),
            *_named(_BY_VIEW, [] if light.from_camera else by_view),
            *gloss_warnings(source, light),
        )
        # Far below a voxel, far above the rounding of coordinates; equal for all depths, so that light can be kept.
        self._lift_world = max(_LIFT_SHARE * side_world, LIFT_SHARE * float(np.abs(source.bounds_world).max()))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences about inputs that cannot be baked."""
        return (*self._warnings, *self._unread.sentences("Material", "baked without values of objects"))

    def bake(
        self, surfels: np.ndarray, samples: int, seed: int, at: Progress, *, colors: bool = False
    ) -> Steps[np.ndarray]:
        """Baked light (N, channels) float32 of surfels (N,) SURFEL, means over `samples` paths each; reports are `at`.

        Of materials whose colors are baked it is over the base color, without opacity where that is black. With
        `colors` it is the base color instead of light.

        A surfel has two texels, each with half of its paths, so that their difference tells its noise. Equal
        surfels in an equal order have equal bits. Raises SceneError, StoppedError.
        """
        blocks = 1 << max(1, int(np.ceil(np.log2(np.sqrt(len(surfels))))))
        size = BLOCK * blocks, BLOCK * max(2, -(-len(surfels) // blocks))
        triangles = yield from computed(
            lambda: surfel_triangles(self._source, surfels, size, self._needs_coordinates), at
        )
        triangles = triangles.only(self._shown[triangles.materials])
        baked = np.zeros((len(surfels), PARTS, self.channels - 1), np.float32)
        for number in np.unique(triangles.links):
            links = self._source.light_links[number]
            for what in (_COLORS,) if colors else (_DIFFUSE, _GLOSSY, _THROUGH):
                chosen = self._translucent if what.through else what.colors | (self._with_gloss == what.gloss)
                part = triangles.only((triangles.links == number) & chosen[triangles.materials])
                for now in self._calls(part, samples):
                    how = samples // PARTS, seed
                    values = yield from self._call(now, size, links, what, how, at)
                    divided = self._color_is_baked[now.materials]
                    if what == _DIFFUSE and divided.any():
                        base = yield from self._call(now.only(divided), size, links, _COLORS, how, at)
                        values[divided] = _over(values[divided], base)
                    if what.through:
                        values[..., -1] = 0.0  # opacity counts once
                    if not colors:
                        values[..., :-1] *= np.where(self._shines[now.materials], 1.0, now.open)[:, None, None]
                    baked[now.number] += values
                    self.paths_traced += samples * len(now)
        half = 0.5 * (baked[:, 0, 0] - baked[:, 1, 0])
        return np.concatenate([baked.mean(axis=1), half[:, None]], axis=1)

    def _calls(self, part: SurfelTriangles, samples: int) -> Iterator[SurfelTriangles]:
        """Divide triangles into calls of at most `most_paths` paths and _MOST_TRIANGLES triangles.

        Blender and Cycles hold copies of all triangles of a call.
        """
        most = int(min(_MOST_TRIANGLES, max(most_paths(self._source.triangle_count) // samples, 1)))
        for first in range(0, len(part), most):
            yield part.only(np.arange(first, min(first + most, len(part))))

    def _call(
        self,
        part: SurfelTriangles,
        size: tuple[int, int],
        links: Links,
        what: _Passes,
        how: tuple[int, int],
        at: Progress,
    ) -> Steps[np.ndarray]:
        """Light (n, PARTS, channels) of triangles, after one bake into an image of a size. how: samples, seed."""
        names, count = self._source.material_names, len(self._source.materials)
        # Materials of fronts, then those of backs.
        used, mine = np.unique(part.materials + count * part.is_back, return_inverse=True)
        part = replace(part, materials=mine.reshape(-1).astype(np.int32))
        with ExitStack() as stack:
            scene, layer = stack.enter_context(bake_scene(self._context, with_daylight=bool(self._light.daylight)))
            set_cycles(scene, *how, self._on_gpu)
            from_camera = self._light.from_camera and scene.camera is not None
            scene.render.bake.view_from = "ACTIVE_CAMERA" if from_camera else "ABOVE_SURFACE"
            image = stack.enter_context(bake_image(size))
            materials: list[bpy.types.Material] = []
            for back in (False, True):
                own = [names[number % count] for number in used if (number >= count) == back]
                views = bake_materials(
                    own, image, back, what.through,
                    oblique=not self._light.from_camera, gloss=what.gloss, unread=self._unread,
                )  # fmt: skip
                materials += stack.enter_context(views)
            mesh = stack.enter_context(temporary(bpy.data.meshes.new("PatchNet Bake")))
            fill_mesh(mesh, part, materials, -self._lift_world if what.through else self._lift_world)
            item = stack.enter_context(bake_object(scene, mesh))
            stack.enter_context(lit_as(item, links))
            target = BakeTarget(scene, scene.view_layers[layer], item, image, what.gloss, what.colors)
            if window_is_alive():
                yield from bake_as_job(self._context, target, at)
            else:
                bake_now(self._context, target)
            light = _light_of(image, self.channels - 1)
        texels = light.reshape(size[1] // BLOCK, BLOCK, size[0] // BLOCK, BLOCK, -1)[:, 0, :, :PARTS]
        return np.asarray(texels.reshape(-1, PARTS, self.channels - 1)[part.number])


def _over(light: np.ndarray, base: np.ndarray) -> np.ndarray:
    """Light (..., C) over the base colour that the same paths met; transparent where that is black."""
    result = np.where(base > _LEAST_COLOR, light / np.maximum(base, _LEAST_COLOR), np.float32(0.0))
    result[..., -1] = light[..., -1] * (base[..., 0] > _LEAST_COLOR)
    return result


def _light_of(image: bpy.types.Image, channels: int) -> np.ndarray:
    """Light (width * height, channels) float32 of the texels of a baked image."""
    width, height = image.size
    pixels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(pixels)
    pixels = np.nan_to_num(pixels.reshape(-1, 4), posinf=0.0, neginf=0.0)
    light = np.empty((len(pixels), channels), np.float32)
    light[:, 0] = np.maximum(pixels[:, :3] @ REC709, 0.0)
    if channels > 2:  # with colour
        light[:, 1:4] = np.maximum(pixels[:, :3], 0.0)
    light[:, -1] = np.clip(pixels[:, 3], 0.0, 1.0)
    return light


def _named(sentence: str, nodes: Sequence[str]) -> tuple[str, ...]:
    """Sentence that names nodes, if there are any."""
    if not nodes:
        return ()
    more = f" and {len(nodes) - _MOST_NAMED} more" if len(nodes) > _MOST_NAMED else ""
    return (sentence.format(", ".join(nodes[:_MOST_NAMED]) + more),)
