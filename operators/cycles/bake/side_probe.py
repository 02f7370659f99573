# SPDX-License-Identifier: GPL-3.0-or-later
"""Probe of the light on both sides of a surface at a few points, by one small bake.

Each point and side has a triangle of its own, far smaller than a voxel and as far off the surface as what is baked, and
a block of texels. No ray meets these triangles.
"""

from __future__ import annotations

from collections import Counter
from contextlib import ExitStack
from functools import partial
from typing import TYPE_CHECKING

import bpy
import numpy as np

from ....patchnet_addon.runtime.progress import Progress, Steps
from ....patchnet_addon.runtime.quantities import named_list
from ....patchnet_addon.runtime.worker import computed
from ....patchnet_addon.surface.chroma import REC709
from ...scene.scene_mesh import SceneMesh
from ...scene_access.polygons import add_polygons
from ...scene_access.temporary import temporary
from ...scene_access.window_job import window_is_alive
from ...schema.table import GLOSS_OFF
from ...settings.groups import LightSettings
from .bake_call import BakeTarget, bake_as_job, bake_now
from .bake_materials import aim
from .bake_scene import bake_scene, page_image, page_object, set_cycles
from .page_mesh import CHART_LAYER

if TYPE_CHECKING:  # they bring numba, which nothing imports before it computes
    from ....patchnet_addon.lightmap.atlas import Atlas
    from ....patchnet_addon.tracing.seen_triangles import Sight

_DARK = 1e-5  # of the brightest triangle: black in any picture
_POINTS = 32  # a camera
_LIT = 1e-3  # of the light on the other side


def black_views(
    context: bpy.types.Context, source: SceneMesh, atlas: Atlas, sight: Sight, light: LightSettings, lift_world: float
) -> Steps[dict[str, str]]:
    """Reason for each camera, by name, whose whole surface in view was baked black; none for others.

    sight: what the cameras see. lift_world: how far off the surface light is measured. Raises SceneError, StoppedError.
    """
    from ....patchnet_addon.octree.voxelize import triangle_areas_and_normals

    at = Progress(0, 1, "Looking for light")
    reasons: dict[str, str] = {}
    brightest = max(float(side.texels[:, 0].max(initial=0.0)) for side in (atlas, atlas.back or atlas))
    for number, camera in enumerate(sight.cameras):
        pixels = np.flatnonzero(sight.seen.triangle[number].ravel() >= 0)
        triangles = sight.seen.triangle[number].ravel()[pixels]
        if not len(pixels):
            continue
        behind = sight.seen.behind[number].ravel()[pixels]
        shown = yield from computed(partial(_shown_light, atlas, triangles, behind, light.has_sides), at)
        if shown.max() > _DARK * brightest:
            continue
        chosen = pixels[np.linspace(0, len(pixels) - 1, min(len(pixels), _POINTS)).astype(int)]
        seen, behind = (values[number].ravel()[chosen] for values in (sight.seen.triangle, sight.seen.behind))
        corners, materials = yield from computed(partial(source.corners_and_materials, seen), at)
        normals = triangle_areas_and_normals(corners)[1]
        places, daylight = sight.places(number, chosen), bool(light.daylight)
        sides = yield from light_of_sides(context, places, normals, lift_world, with_daylight=daylight, at=at)
        lit = np.where(behind, sides[:, 1], sides[:, 0])
        names, most = source.objects_of(seen), sides.max(axis=1)
        reasons[camera.name] = _no_light(names, lit, most) or _black_material(
            source, atlas, names[lit > 0.0], materials[lit > 0.0], light.gloss == GLOSS_OFF
        )
    return reasons


def _shown_light(atlas: Atlas, triangles: np.ndarray, behind: np.ndarray, has_sides: bool) -> np.ndarray:
    """Mean light (N,) that triangles (N,) show to who sees them from `behind` (N,) or not."""
    from ....patchnet_addon.lightmap.chart_lookup import triangle_means

    front = triangle_means(atlas.charts, atlas.texels, triangles)[:, 0]
    if atlas.back is None or atlas.facing is None or atlas.back_share is None:
        return front
    facing, share = atlas.facing[triangles], atlas.back_share[triangles]
    if has_sides:
        share = np.where(facing == 0, behind, facing < 0)
    return np.asarray((1.0 - share) * front + share * triangle_means(atlas.charts, atlas.back.texels, triangles)[:, 0])


def _no_light(names: np.ndarray, lit: np.ndarray, most: np.ndarray) -> str:
    """Reason if no light falls on what is seen at N points, "" if some does.

    names: objects. lit, most: light on the side that is seen, and on the one that gets most.
    """
    objects = named_list(name for name, _ in Counter(names.tolist()).most_common())
    if most.max() <= 0.0:
        return f"no light of the scene reaches {objects}; add light, or look at the lamps' strength and visibility"
    if np.median(lit) <= _LIT * np.median(most):
        return f"light falls on the other side of {objects} alone, in Cycles too"
    return ""


def _black_material(
    source: SceneMesh, atlas: Atlas, names: np.ndarray, materials: np.ndarray, without_gloss: bool
) -> str:
    """Reason why the surface is black that most of what is lit belongs to. materials: (N,), names: their objects."""
    number, _ = Counter(materials.tolist()).most_common(1)[0]
    material, owner = source.materials[number], names[np.flatnonzero(materials == number)[0]]
    why = ", in Cycles too"
    if source.gloss[number].is_glossy and without_gloss:
        why = " without its gloss; choose Gloss: Automatic"
    elif notes := [text for text in source.warnings if text.startswith("Material") and f"'{material.name}'" in text]:
        why = f": {notes[0]}"
    elif any(f"of material '{material.name}'" in text for text in atlas.warnings):
        why = " without what depends on the view or on whole objects"
    elif max(*material.base_color, *material.emission) <= 0.0:
        why = "; give it a color"
    return f"the material '{source.material_names[number]}' of '{owner}' is black{why}"


SAMPLES = 64  # a texel
_BLOCK = 4  # texels of a side of a point's block
# Rows and columns of it whose centres its triangle covers.
_OWN = np.add.outer(np.arange(_BLOCK), np.arange(_BLOCK)) < _BLOCK - 2
_PER_ROW = 32  # blocks
_NAME = "PatchNet Probe"


def light_of_sides(
    context: bpy.types.Context,
    points_world: np.ndarray,
    normals: np.ndarray,
    lift_world: float,
    *,
    with_daylight: bool,
    at: Progress,
) -> Steps[np.ndarray]:
    """Luminance (N, 2) float32 that white matt surface would have at points (N, 3) on the side of unit normals (N, 3),
    and on the other.

    lift_world: how far off the surface. with_daylight: sun and sky of ours shine. The scene is as before afterwards.
    Reports are `at`. Raises SceneError, StoppedError.
    """
    yield at
    count = 2 * len(points_world)
    size = np.array([_PER_ROW, -(-count // _PER_ROW)]) * _BLOCK
    with ExitStack() as stack:
        scene, layer = stack.enter_context(bake_scene(context, with_daylight=with_daylight))
        set_cycles(scene, SAMPLES, 0, on_gpu=False)
        image = stack.enter_context(page_image(size, 1))
        mesh = stack.enter_context(temporary(bpy.data.meshes.new(_NAME)))
        _fill(mesh, points_world, normals, lift_world)
        white = stack.enter_context(temporary(bpy.data.materials.new(_NAME)))
        white.diffuse_color = (1.0, 1.0, 1.0, 1.0)
        aim(white, image, plain=True)
        mesh.materials.append(white)
        item = stack.enter_context(page_object(scene, mesh))
        target = BakeTarget(scene, scene.view_layers[layer], item, image)
        if window_is_alive():
            yield from bake_as_job(context, target, at)
        else:
            bake_now(context, target)
        return _means(image, count).reshape(-1, 2)


def _fill(mesh: bpy.types.Mesh, points: np.ndarray, normals: np.ndarray, lift: float) -> None:
    """Give the mesh two triangles a point, one on each side, and their places in the image."""
    both = np.stack([normals, -normals], axis=1).reshape(-1, 3)
    centers = np.repeat(points, 2, axis=0) + lift * both
    least = np.abs(both).argmin(axis=1)
    along = np.cross(both, np.eye(3)[least])
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.cross(both, along)
    corners = np.stack([centers - along, centers + along, centers + across], axis=1)
    corners = centers[:, None] + (corners - centers[:, None]) * lift
    count = len(both)
    add_polygons(mesh, corners)
    mesh.update(calc_edges=True)
    row, column = np.divmod(np.arange(count), _PER_ROW)
    rows = -(-count // _PER_ROW)
    low = np.stack([column / _PER_ROW, row / rows], axis=1)
    side = np.array([1.0 / _PER_ROW, 1.0 / rows]) * (1.0 - 1.0 / _BLOCK)  # nothing of the next block
    places = np.stack([low, low + side * [1.0, 0.0], low + side * [0.0, 1.0]], axis=1).astype(np.float32)
    mesh.uv_layers.new(name=CHART_LAYER).data.foreach_set("uv", places.ravel())


def _means(image: bpy.types.Image, count: int) -> np.ndarray:
    """Mean luminance (count,) of the texels of each block that its triangle owns.

    Which were baked does not tell them: Blender 5.3 also bakes all texels that a triangle touches, of the next block
    too.
    """
    width, height = image.size
    pixels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(pixels)
    pixels = np.nan_to_num(pixels, posinf=0.0, neginf=0.0).reshape(height // _BLOCK, _BLOCK, -1, _BLOCK, 4)
    blocks = pixels.transpose(0, 2, 1, 3, 4).reshape(-1, _BLOCK, _BLOCK, 4)[:count]
    result: np.ndarray = (blocks[:, _OWN, :3] @ REC709).mean(axis=1).astype(np.float32)
    return result
