# SPDX-License-Identifier: GPL-3.0-or-later
"""Pixels that only Cycles shows as they are: of gloss, clear glass, volumes and objects that voxels leave out."""

from __future__ import annotations

from typing import NamedTuple

import bpy
import numpy as np

from ...patchnet_addon.tracing.camera import Camera
from ..scene.images import ImageReader
from ..scene.materials import is_partly_transparent, read_material
from ..scene.read import LEFT_OUT, read_scene
from ..scene.scene_mesh import SceneMesh
from ..scene.surface_instances import shown_instances, shows_itself
from ..scene_access.blender_version import tree_in_use
from ..schema.table import VISIBLE

# Triangles of a box, by its corners in Blender's order.
_SIDES = np.array([[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6], [0, 4, 5], [0, 5, 1],
                   [3, 2, 6], [3, 6, 7], [0, 3, 7], [0, 7, 4], [1, 5, 6], [1, 6, 2]])  # fmt: skip


class WantedSurface(NamedTuple):
    """Surface of a scene, and what of it Cycles has to show.

    shown, wanted: of each material, whether it is seen at all, and only by Cycles as it is. boxes: (B, 8, 3) corners
    around objects that have no surface.
    """

    source: SceneMesh
    shown: np.ndarray
    wanted: np.ndarray
    boxes: np.ndarray


def wanted_surface(depsgraph: bpy.types.Depsgraph) -> WantedSurface:
    """Read what renders show of a scene; raises PatchNetError."""
    source = read_scene(depsgraph, VISIBLE)
    library = {material.name_full: material for material in bpy.data.materials}
    kinds = [_kind(library.get(name)) for name in source.material_names]
    glossy = np.array([gloss.is_glossy or gloss.is_clear for gloss in source.gloss], bool)
    there = np.array([item.alpha > 0.0 for item in source.materials], bool)
    unlike = np.array(kinds, bool)
    boxes = [
        np.array(item.bound_box) @ matrix[:3, :3].T + matrix[:3, 3]
        for item, matrix in (
            (each.object, np.array(each.matrix_world))
            for each in shown_instances(depsgraph, VISIBLE)
            if each.object.type in LEFT_OUT and shows_itself(each)
        )
    ]
    return WantedSurface(source, there | unlike, glossy | unlike, np.array(boxes).reshape(-1, 8, 3))


def _kind(material: bpy.types.Material | None) -> bool:
    """Return whether a material fills its inside, or is partly transparent everywhere."""
    tree = tree_in_use(material) if material is not None else None
    output = tree and (tree.get_output_node("CYCLES") or tree.get_output_node("ALL"))
    if not output:
        return False
    if output.inputs["Volume"].is_linked:
        return True
    reading = read_material(material, ImageReader()).material
    return reading.alpha_texture is None and is_partly_transparent(reading)


def wanted_pixels(surface: WantedSurface, camera: Camera) -> np.ndarray:
    """(H, W) bool: pixels of a camera whose nearest surface, at their centres, is wanted, or lies behind a box."""
    from ...patchnet_addon.tracing.seen_triangles import Sight

    size = camera.width_px, camera.height_px
    sight, around = Sight([camera], size), Sight([camera], size)
    wanted = [np.zeros(0, bool)]
    for batch in surface.source.batches():
        sight.add(batch.corners_world, surface.shown[batch.materials], batch.first_triangle)
        wanted.append(surface.wanted[batch.materials])
    seen = sight.seen.triangle[0]
    mask: np.ndarray = (seen >= 0) & np.concatenate(wanted)[seen]
    sides = surface.boxes[:, _SIDES].reshape(-1, 3, 3)
    around.add(sides, np.ones(len(sides), bool), 0)
    return mask | (around.seen.depth[0] < sight.seen.depth[0]) | any(_is_in(box, camera) for box in surface.boxes)


def _is_in(box: np.ndarray, camera: Camera) -> bool:
    """Return whether a camera stands in a box (8, 3), which then is before all that it sees."""
    edges = box[[4, 3, 1]] - box[0]
    share = np.linalg.lstsq(edges.T, camera.position_world - box[0], rcond=None)[0]
    return bool(((share >= 0.0) & (share <= 1.0)).all())
