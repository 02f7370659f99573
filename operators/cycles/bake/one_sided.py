# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials of one side: those whose surfaces are baked on one side alone, if they are sheets."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np

from ....patchnet_addon.surface.mesh import Material
from ...scene.scene_mesh import SceneMesh
from ...settings.groups import LightSettings
from ..daylight import emits
from .translucency import is_translucent


def one_sided_materials(source: SceneMesh, light: LightSettings) -> np.ndarray:
    """(M,) bool: opaque materials, unless both sides are wanted, and all that cull backfaces."""
    culling = {item.name_full for item in bpy.data.materials if item.use_backface_culling}
    one_sided = np.array([name in culling for name in source.material_names], bool)
    if not light.both_sides:
        opaque = np.array([is_opaque(material) for material in source.materials], bool)
        one_sided |= opaque & ~translucent_materials(source)
    return one_sided


def translucent_materials(source: SceneMesh) -> np.ndarray:
    """(M,) bool: materials through which light shines from behind."""
    return _those_that(is_translucent, source)


def shining_materials(source: SceneMesh) -> np.ndarray:
    """(M,) bool: materials that shine by themselves, on one side perhaps."""
    return _those_that(emits, source)


def _those_that(applies: Callable[[bpy.types.Material], bool], source: SceneMesh) -> np.ndarray:
    """(M,) bool: materials of the surface that something applies to."""
    used = set(source.material_names)
    names = {item.name_full for item in bpy.data.materials if item.name_full in used and applies(item)}
    return np.array([name in names for name in source.material_names], bool)


def shows(material: Material) -> bool:
    """Return whether a surface shows anything: clear glass does not."""
    return material.alpha > 0.0 or material.alpha_texture is not None


def is_opaque(material: Material) -> bool:
    """Return whether a surface has no gaps: leaves and grilles have, and are meant to be seen from both sides."""
    return material.alpha >= 1.0 and material.alpha_texture is None
