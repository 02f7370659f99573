# SPDX-License-Identifier: GPL-3.0-or-later
"""Reasons why a camera sees only black surface, found by measuring the light that falls on it."""

from __future__ import annotations

from collections import Counter
from functools import partial
from typing import TYPE_CHECKING

import bpy
import numpy as np

from ....patchnet_addon.runtime.progress import Progress, Steps
from ....patchnet_addon.runtime.wording import named_list
from ....patchnet_addon.runtime.worker import computed
from ...scene.scene_mesh import SceneMesh
from ...schema.table import GLOSS_OFF
from ...settings.groups import LightSettings
from .side_probe import light_of_sides

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
    from ....patchnet_addon.lightmap.chart_lookup import triangle_means
    from ....patchnet_addon.octree.voxelize import triangle_areas_and_normals

    at = Progress(0, 1, "Looking for light")
    reasons: dict[str, str] = {}
    brightest = float(atlas.texels[:, 0].max(initial=0.0))
    for number, camera in enumerate(sight.cameras):
        pixels = np.flatnonzero(sight.seen.triangle[number].ravel() >= 0)
        triangles = sight.seen.triangle[number].ravel()[pixels]
        if not len(pixels):
            continue
        distinct = np.unique(triangles)
        means = yield from computed(partial(triangle_means, atlas.charts, atlas.texels, distinct), at)
        if means[:, 0].max() > _DARK * brightest:
            continue
        chosen = pixels[np.linspace(0, len(pixels) - 1, min(len(pixels), _POINTS)).astype(int)]
        seen, behind = (values[number].ravel()[chosen] for values in (sight.seen.triangle, sight.seen.behind))
        corners, materials = yield from computed(partial(source.corners_and_materials, seen), at)
        normals = triangle_areas_and_normals(corners)[1]
        sides = yield from light_of_sides(
            context, sight.places(number, chosen), normals, lift_world, with_daylight=bool(light.daylight), at=at
        )
        lit = np.where(behind, sides[:, 1], sides[:, 0])
        names, most = source.objects_of(seen), sides.max(axis=1)
        reasons[camera.name] = _no_light(names, lit, most) or _black_material(
            source, atlas, names[lit > 0.0], materials[lit > 0.0], light.gloss == GLOSS_OFF
        )
    return reasons


def _no_light(names: np.ndarray, lit: np.ndarray, most: np.ndarray) -> str:
    """Reason if no light falls on what is seen at N points, "" if some does.

    names: objects. lit, most: light on the side that is seen, and on the one that gets most.
    """
    objects = named_list(name for name, _ in Counter(names.tolist()).most_common())
    if most.max() <= 0.0:
        return f"no light of the scene reaches {objects}; add light, or look at the lamps' strength and visibility"
    if np.median(lit) <= _LIT * np.median(most):
        return f"light falls on the other side of {objects}; flip its normals (Mesh > Normals)"
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
