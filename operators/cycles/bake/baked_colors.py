# SPDX-License-Identifier: GPL-3.0-or-later
"""Base colours that only Cycles knows, such as those of procedural textures: baked, finer than light is.

Light over base colour varies slowly, so that light cells may be larger than leaves, and filtered; colours do not.
"""

from __future__ import annotations

import numpy as np

from ....patchnet_addon.surface.scene_mesh import SceneMesh
from .gloss_passes import baked_with_gloss
from .one_sided import is_opaque, translucent_materials


def color_is_baked(source: SceneMesh, gloss: str) -> np.ndarray:
    """(M,) bool: opaque materials with diffuse light alone, in proportion to a base colour that is not known."""
    plain = [
        is_opaque(material) and not material.base_is_known and max(material.emission) <= 0.0
        for material in source.materials
    ]
    return np.array(plain, bool) & ~translucent_materials(source) & ~baked_with_gloss(source, gloss)
