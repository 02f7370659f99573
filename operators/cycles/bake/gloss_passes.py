# SPDX-License-Identifier: GPL-3.0-or-later
"""Gloss in a bake: its materials, its view, and warnings about its limits."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import bpy
import numpy as np

from ....patchnet_addon.runtime.errors import SceneError
from ....patchnet_addon.runtime.quantities import subject
from ....patchnet_addon.surface.scene_mesh import SceneMesh
from ...schema.values import GLOSS_AUTO, GLOSS_CAMERA, GLOSS_OFF
from ...settings.groups import LightSettings

REFINE = "use Refine with Cycles, Passes: Combined"
_TINTED = 0.2  # share of transmitted light from which on materials other than clear glass are mentioned


def baked_with_gloss(source: SceneMesh, setting: str) -> np.ndarray:
    """(M,) bool: materials of `source` whose gloss is baked."""
    if setting == GLOSS_OFF:
        return np.zeros(len(source.materials), bool)
    if setting == GLOSS_AUTO:
        return np.array([gloss.is_glossy for gloss in source.gloss], bool)
    return np.array([gloss.glossy > 0.0 or gloss.clear > 0.0 for gloss in source.gloss], bool)


def seen_through(source: SceneMesh, setting: str) -> SceneMesh:
    """Surface without clear glass, unless it is all of the surface, or gloss is off."""
    clear = [gloss.is_clear for gloss in source.gloss]
    if setting == GLOSS_OFF or not any(clear) or all(clear):
        return source
    materials = tuple(
        replace(material, alpha=0.0, alpha_texture=None) if through else material
        for material, through in zip(source.materials, clear, strict=True)
    )
    return replace(source, materials=materials)


def with_view(
    scene: bpy.types.Scene, light: LightSettings, cameras: Sequence[str], *, track: bool = False
) -> LightSettings:
    """Settings with a decision whether gloss is baked as seen from the active camera.

    cameras: names of the job's cameras, none for the active one. track: whether they count at all frames. Automatic
    uses the active camera's view if it is the only one, so that metals and mirrors are correct in it. Raises SceneError
    if it is needed and missing.
    """
    if light.from_camera is not None:
        return light
    camera = scene.camera
    if light.gloss == GLOSS_CAMERA and camera is None:
        raise SceneError(
            f"Scene '{scene.name}' has no active camera, which Gloss: From Camera needs: add a camera, or "
            "choose another Gloss"
        )
    alone = camera is not None and set(cameras) <= {camera.name} and not track
    return replace(light, from_camera=light.gloss == GLOSS_CAMERA or (light.gloss == GLOSS_AUTO and alone))


def gloss_warnings(source: SceneMesh, light: LightSettings) -> tuple[str, ...]:
    """Sentences about materials that voxels show differently from a render."""
    if not any(gloss.is_glossy or gloss.clear > _TINTED for gloss in source.gloss):
        return ()
    kinds = list(zip(source.material_names, source.gloss, strict=False))
    clear = [name for name, gloss in kinds if gloss.is_clear]
    rest = [(name, gloss) for name, gloss in kinds if not gloss.is_clear]
    tinted = [name for name, gloss in rest if gloss.clear > _TINTED]
    if light.gloss == GLOSS_OFF:
        dark = [name for name, gloss in kinds if gloss.is_glossy]
        return _named(dark, "baked without gloss, and black: choose Gloss: Automatic")
    sharp = [name for name, gloss in rest if gloss.is_glossy and gloss.is_sharp and name not in tinted]
    if light.from_camera:
        mirrors = f"baked with reflections as the active camera sees them, wrong from elsewhere: there {REFINE}"
    else:
        mirrors = (
            "baked with reflections as seen from above the surface, not as cameras see them: choose Gloss: From Camera "
            f"for one view, or {REFINE}"
        )
    return (
        *_named(sharp, mirrors),
        *_named(clear, f"see-through, without reflections and refraction: {REFINE} for these"),
        *_named(tinted, f"baked as if opaque, with what shines through: {REFINE} to see through"),
    )


def _named(names: Iterable[str], what: str) -> tuple[str, ...]:
    """Sentence that names materials, if there are any."""
    begun = subject("Material", names)
    return (f"{begun} {what}",) if begun else ()
