# SPDX-License-Identifier: GPL-3.0-or-later
"""Refinement by Cycles: render the worst pixels of a traced view by Cycles, by their ranking.

All other pixels get 16 rays of the octree, which are cheap.
"""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np

from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.process.computed import computed
from ...patchnet_addon.runtime.errors import SettingError
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.tracing.camera import Camera
from ..computing.cycles_pixels import Chosen, CyclesView, Renders, WantedSurface, composited, wanted_pixels
from ..computing.views import View
from ..cycles.daylight import has_light
from ..cycles.pixel_renders import pixel_renders
from ..scene.images import ImageReader
from ..scene.materials import is_partly_transparent, read_material
from ..scene.read import LEFT_OUT, read_scene
from ..scene.render_geometry import render_geometry, shown_instances, shows_itself
from ..scene_access.blender_version import tree_in_use
from ..schema.values import CYCLES, DIFFUSE, GLOSS_OFF, VISIBLE
from ..settings.cycles_settings import REFERENCE_FACTOR, REFERENCE_SEED, WITH_GLOSS, CyclesSettings

_LEFT = (
    "{name}: {left:.1%} of the pixels show gloss, clear glass or what voxels leave out, and are not rendered: raise "
    "Pixels of Refine with Cycles"
)
NOT_CYCLES = "The voxels have no light from Cycles: run Bake Light with Light: Cycles first"


def wanted_surface(depsgraph: bpy.types.Depsgraph) -> WantedSurface:
    """Read the rendered surface of a scene; raises PatchNetError."""
    with render_geometry(depsgraph):
        source = read_scene(depsgraph, VISIBLE)
        boxes = [
            np.array(item.bound_box) @ matrix[:3, :3].T + matrix[:3, 3]
            for item, matrix in (
                (each.object, np.array(each.matrix_world))
                for each in shown_instances(depsgraph, VISIBLE)
                if each.object.type in LEFT_OUT and shows_itself(each)
            )
        ]
    library = {material.name_full: material for material in bpy.data.materials}
    kinds = [_kind(library.get(name)) for name in source.material_names]
    glossy = np.array([gloss.is_glossy or gloss.is_clear for gloss in source.gloss], bool)
    there = np.array([item.alpha > 0.0 for item in source.materials], bool)
    unlike = np.array(kinds, bool)
    return WantedSurface(source, there | unlike, glossy | unlike, np.array(boxes).reshape(-1, 8, 3))


def _kind(material: bpy.types.Material | None) -> bool:
    """Return whether a material has a volume, or is partly transparent everywhere."""
    tree = tree_in_use(material) if material is not None else None
    output = tree and (tree.get_output_node("CYCLES") or tree.get_output_node("ALL"))
    if not output:
        return False
    if output.inputs["Volume"].is_linked:
        return True
    reading = read_material(material, ImageReader()).material
    return reading.alpha_texture is None and is_partly_transparent(reading)


def refine_view(
    context: bpy.types.Context, view: View, settings: CyclesSettings, *, sun: bool | None
) -> Steps[CyclesView]:
    """Render a view's worst pixels with Cycles, in a copy of the scene.

    Other pixels get OWN_SIDE x OWN_SIDE rays of the octree. sun: whether the octree was lit by our sun and sky; None:
    if the scene has no light. Raises PatchNetError.
    """
    octree, camera, buffers = view.octree, view.camera, view.buffers
    check_light(octree)
    choosing = Progress(0, 1, f"{camera.name}: choosing pixels")
    depsgraph = context.evaluated_depsgraph_get()
    surface = wanted_surface(depsgraph)
    wanted = yield from computed(wanted_pixels, surface, camera, at=choosing)
    mask = buffers.picture(view.ranking.chosen(wanted.mask.ravel(), settings.budget))
    added = not has_light(depsgraph) if sun is None else sun
    gloss = bool(wanted.mask.any()) or octree.provenance.get("gloss", GLOSS_OFF) != GLOSS_OFF
    light = WITH_GLOSS if settings.light == DIFFUSE and gloss else settings.light
    renders = yield from _rendered(context, camera, wanted._replace(mask=mask), (settings, light), added)
    tracing = Progress(0, 1, f"{camera.name}: tracing all others")
    result: CyclesView = yield from computed(composited, view, mask, renders, settings, at=tracing)
    left = float((wanted.mask & ~mask).mean())
    result.report["wanted"] = {"pixels_share": float(wanted.mask.mean()), "left_share": left}
    return replace(result, warnings=(_LEFT.format(name=camera.name, left=left),) if left else ())


def check_light(octree: Octree) -> None:
    """Raise SettingError if the light of this octree is not that of Cycles."""
    if octree.provenance.get("light") != CYCLES:
        raise SettingError(NOT_CYCLES)


def _rendered(
    context: bpy.types.Context, camera: Camera, chosen: Chosen, rendered: tuple[CyclesSettings, str], sun: bool
) -> Steps[Renders]:
    """Render the pixels and, to compare, the whole picture and the reference.

    The whole picture has a scene copy of its own, so that its time includes reading the scene.
    """
    settings, light = rendered
    result = Renders(np.zeros((camera.height_px, camera.width_px, 4), np.float32))
    if chosen.mask.any():
        with pixel_renders(context, camera, light, chosen, sun=sun) as cycles:
            yield from cycles.synced()
            result.pixels = yield from cycles.picture(settings.samples, 0, f"{camera.name}: Cycles")
            result.sync_seconds, result.seconds = cycles.sync_seconds, cycles.seconds
    if settings.compare:
        with pixel_renders(context, camera, light, sun=sun) as cycles:
            label = f"{camera.name}: Cycles, the whole picture"
            result.full = yield from cycles.picture(settings.samples, 0, label, at_once=True)
            result.full_seconds = cycles.seconds
            samples, label = REFERENCE_FACTOR * settings.samples, f"{camera.name}: Cycles, the reference"
            result.reference = yield from cycles.picture(samples, REFERENCE_SEED, label)
    return result
