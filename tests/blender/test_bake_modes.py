# SPDX-License-Identifier: GPL-3.0-or-later
"""Bake light in Edit Mode and Sculpt Mode: the edited mesh counts, the mode stays."""

from pathlib import Path

import bmesh
import bpy
import numpy as np
import pytest

from patchnet.tests.blender.full_scene import build_full
from patchnet.tests.blender.light_scene import bake_surfels

pytestmark = pytest.mark.usefixtures("registered")


@pytest.mark.parametrize("mode", ["EDIT", "SCULPT"])
def test_light_of_a_mesh_that_is_edited(mode: str, tmp_path: Path) -> None:
    build_full(tmp_path, mode)
    slab = bpy.context.view_layer.objects.active
    if mode == "EDIT":
        mesh = bmesh.from_edit_mesh(slab.data)
        for vertex in mesh.verts:
            vertex.co *= 0.5
        bmesh.update_edit_mesh(slab.data)
    while_edited = bake_surfels(2).luminance
    assert slab.mode == mode
    bpy.ops.object.mode_set(mode="OBJECT")
    afterwards = bake_surfels(2).luminance
    assert np.allclose(while_edited, afterwards, atol=1e-6)  # rounding: Cycles builds its trees in threads
    assert while_edited.max() > 0
