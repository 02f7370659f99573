# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials with one side: their one luminance is that of one side; that of others is the mean of both.

Translucent light shines through a surface from behind (shader Translucent). The baked mesh lies above the surface,
which blocks this light, so it is baked in a call of its own from below.
"""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np

from ....patchnet_addon.surface.mesh import Material
from ....patchnet_addon.surface.scene_mesh import SceneMesh
from ...scene.layer_names import all_nodes
from ...scene_access.blender_version import tree_in_use

_TRANSLUCENT = "BSDF_TRANSLUCENT"
_SHADERS = ("BSDF_", "EMISSION", "SUBSURFACE_SCATTERING", "HOLDOUT", "BACKGROUND")  # all shaders but mixes and groups


def is_translucent(material: bpy.types.Material) -> bool:
    """Return whether light shines through a material diffusely."""
    tree = tree_in_use(material)
    return tree is not None and any(node.type == _TRANSLUCENT for node in all_nodes(tree))


def needs_cut(tree: bpy.types.NodeTree, through: bool) -> bool:
    """Return whether `keep_sides` changes anything in a tree or in a group of it."""
    return any(_is_cut(node, through) for node in all_nodes(tree))


def _is_cut(node: bpy.types.Node, through: bool) -> bool:
    return node.type.startswith(_SHADERS) and (node.type == _TRANSLUCENT) != through


def keep_sides(tree: bpy.types.NodeTree, through: bool) -> None:
    """Cut off Translucent shaders of a tree, or, if `through`, all others; groups in it are left to the caller."""
    for node in tree.nodes:
        if _is_cut(node, through):
            for link in [link for socket in node.outputs for link in socket.links]:
                tree.links.remove(link)


def one_sided_materials(source: SceneMesh) -> np.ndarray:
    """(M,) bool: opaque materials, and all that cull backfaces."""
    opaque = np.array([is_opaque(material) for material in source.materials], bool)
    culls = materials_that(lambda material: material.use_backface_culling, source)
    return (opaque & ~translucent_materials(source)) | culls


def translucent_materials(source: SceneMesh) -> np.ndarray:
    """(M,) bool: translucent materials."""
    return materials_that(is_translucent, source)


def materials_that(applies: Callable[[bpy.types.Material], bool], source: SceneMesh) -> np.ndarray:
    """(M,) bool: materials of the surface that a predicate accepts."""
    used = set(source.material_names)
    names = {item.name_full for item in bpy.data.materials if item.name_full in used and applies(item)}
    return np.array([name in names for name in source.material_names], bool)


def shows(material: Material) -> bool:
    """Return whether a surface is not fully transparent."""
    return material.alpha > 0.0 or material.alpha_texture is not None


def is_opaque(material: Material) -> bool:
    """Return whether a surface is fully opaque; cut-outs such as leaves are meant to be seen from both sides."""
    return material.alpha >= 1.0 and material.alpha_texture is None
