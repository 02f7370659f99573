# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles bake of surfels: a small triangle with a texel of its own for each, lifted off the surface and seen by no ray.

Objects with different light links, translucent light and gloss are baked in calls of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack

import bpy
import numpy as np

from ....patchnet_addon.light.surfel_calls import (
    COLORS,
    BakedMaterials,
    CallMesh,
    CallsInput,
    Passes,
    PlannedCall,
    PlannedCalls,
    add_call,
    finished_light,
    mesh_of,
    plan_calls,
)
from ....patchnet_addon.light.surfel_triangles import PARTS
from ....patchnet_addon.process.computed import computed, engine_pid
from ....patchnet_addon.process.segments import shared_zeros
from ....patchnet_addon.runtime.omissions import Omissions
from ....patchnet_addon.runtime.progress import Progress, Steps
from ....patchnet_addon.surface.scene_mesh import SceneMesh
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
from .object_data import OBJECT, lost_inputs, needs_coordinates
from .one_sided import shows, translucent_materials
from .surfel_mesh import fill_mesh

_MOST_NAMED = 12  # nodes in a sentence
_BY_VIEW = (
    "Diffuse roughness and sheen are baked as the mean of all views: {}: choose Gloss: From Camera for one view, or "
    f"{REFINE}"
)
_MOST_TRIANGLES = 1 << 22  # of a call
_LIFT_SHARE = 2e-6  # of the octree's cube


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
        self._materials = BakedMaterials(
            shown=np.array([shows(material) for material in source.materials], bool),
            with_gloss=baked_with_gloss(source, light.gloss),
            translucent=translucent_materials(source),
            color_is_baked=color_is_baked(source, light.gloss),
            shines=np.array([max(material.emission) > 0.0 for material in source.materials], bool),
        )
        used = [material for material in bpy.data.materials if material.name_full in source.material_names]
        self._coordinates = OBJECT if needs_coordinates(used) else ""
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
        `colors` it is the base color instead of light. Equal surfels in an equal order have equal bits. Raises
        SceneError, StoppedError.
        """
        # Blender and Cycles hold copies of all triangles of a call.
        most = int(min(_MOST_TRIANGLES, max(most_paths(self._source.triangle_count) // samples, 1)))
        how = CallsInput(self._materials, self._coordinates, self.channels - 1, self._lift_world, most, colors)
        plan: PlannedCalls = yield from computed(plan_calls, self._source, surfels, how, at=at)
        for call in plan.calls:
            sampling = samples // PARTS, seed
            pixels = yield from self._call(plan, call, call.passes, sampling, at)
            base = None
            if call.is_divided:
                base = yield from self._call(plan, call, COLORS, sampling, at)
            yield from computed(add_call, plan.work, call, pixels, base, at=at)
            self.paths_traced += samples * call.triangles
        return (yield from computed(finished_light, plan.work, at=at))

    def _call(
        self, plan: PlannedCalls, call: PlannedCall, passes: Passes, sampling: tuple[int, int], at: Progress
    ) -> Steps[np.ndarray]:
        """Pixels (height * width * 4,) float32 of the image of a call. sampling: samples, seed."""
        names, links = self._source.material_names, self._source.light_links[call.links]
        part: CallMesh = yield from computed(mesh_of, plan.work, call.number, passes, at=at)
        with ExitStack() as stack:
            scene, layer = stack.enter_context(bake_scene(self._context, with_daylight=bool(self._light.daylight)))
            set_cycles(scene, *sampling, self._on_gpu)
            from_camera = self._light.from_camera and scene.camera is not None
            scene.render.bake.view_from = "ACTIVE_CAMERA" if from_camera else "ABOVE_SURFACE"
            image = stack.enter_context(bake_image(plan.size))
            yield at  # a window draws between the parts of this
            materials: list[bpy.types.Material] = []
            for back in (False, True):
                own = [names[number] for number, is_back in part.used if is_back == back]
                views = bake_materials(
                    own, image, back, passes.through,
                    oblique=not self._light.from_camera, gloss=passes.gloss, unread=self._unread,
                )  # fmt: skip
                materials += stack.enter_context(views)
            yield at
            mesh = stack.enter_context(temporary(bpy.data.meshes.new("PatchNet Bake")))
            fill_mesh(mesh, part, materials)
            yield at
            item = stack.enter_context(bake_object(scene, mesh))
            stack.enter_context(lit_as(item, links))
            target = BakeTarget(scene, scene.view_layers[layer], item, image, passes.gloss, passes.colors)
            if window_is_alive():
                yield from bake_as_job(self._context, target, at)
            else:
                bake_now(self._context, target)
            count = 4 * image.size[0] * image.size[1]
            # Where a process computes, it reads the pixels without a copy.
            pixels = np.empty(count, np.float32) if engine_pid() is None else shared_zeros((count,), np.float32)
            image.pixels.foreach_get(pixels)
            return pixels


def _named(sentence: str, nodes: Sequence[str]) -> tuple[str, ...]:
    """Sentence that names nodes, if there are any."""
    if not nodes:
        return ()
    more = f" and {len(nodes) - _MOST_NAMED} more" if len(nodes) > _MOST_NAMED else ""
    return (sentence.format(", ".join(nodes[:_MOST_NAMED]) + more),)
