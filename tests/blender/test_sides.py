# SPDX-License-Identifier: GPL-3.0-or-later
"""Light of both sides of thin objects against Cycles."""

from collections.abc import Callable

import bpy
import numpy as np
import pytest

from patchnet.operators.scene.cameras import choose_cameras
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.tracing.supersample import supersample
from patchnet.tests.blender import shaders
from patchnet.tests.blender.light_scene import lit, mean_ratios
from patchnet.tests.blender.objects import CUBE_FACES, corners, lamp, link, look_from, mesh
from patchnet.tests.blender.shaders import simple

PLAIN = {"Specular_IOR_Level": 0.0}  # a specular layer dims light as in the mean of all views: test_mean_view.py
INWARD = [tuple(reversed(face)) for face in CUBE_FACES]
BOTTOM = next(face for face in CUBE_FACES if all(not corner & 1 for corner in face))  # of `box`: z is its lowest bit


def box(name: str, low: float, high: float, gray: float, faces: list[tuple[int, ...]]) -> None:
    paint = simple("BsdfPrincipled", name, Base_Color=(gray, gray, gray, 1.0), **PLAIN)
    link(mesh(name, corners((-1, -1, low), (1, 1, high)), faces, paint))


def cloth_on_table() -> None:
    box("Table", -0.03, 0.0, 0.02, CUBE_FACES)
    paint = simple("BsdfPrincipled", "Cloth", Base_Color=(0.8, 0.8, 0.8, 1.0), **PLAIN)
    link(mesh("Cloth", [(-1, -1, 0.007), (1, -1, 0.007), (1, 1, 0.007), (-1, 1, 0.007)], [(0, 1, 2, 3)], paint))


SCENES: dict[str, Callable[[], None]] = {
    "plate": lambda: box("Plate", 0.0, 0.01, 0.6, CUBE_FACES),
    "plate inside out": lambda: box("Plate", 0.0, 0.01, 0.6, INWARD),
    "tile without a bottom": lambda: box("Tile", 0.0, 0.01, 0.6, [face for face in CUBE_FACES if face != BOTTOM]),
    "cloth on a table": cloth_on_table,
}


def ratios(sides: str) -> list[float]:
    """Mean luminance of voxels over that of Cycles, from above and from below."""
    return mean_ratios(size=(24, 24), max_samples=32, cameras=("Above", "Below"), sides=sides, shape="boxes")


@pytest.mark.parametrize("scene", SCENES)
def test_both_sides_are_as_bright_as_in_cycles(scene: str) -> None:
    bpy.ops.wm.read_homefile(use_empty=True)
    shaders.world().nodes["Background"].inputs["Color"].default_value = (0.1, 0.1, 0.1, 1.0)
    SCENES[scene]()
    link(mesh("Marker", [(1, 1, 0), (1, 0.9, 0.37), (1, 1, 0.37)], [(0, 1, 2)]))  # or the cube's middle divides a plate
    lamp("SUN", 3.0, (0, 0, 3))
    for name, height in (("Above", 1.5), ("Below", -1.5)):
        look_from((0.3, 0.2, height), (0.0, 0.0, 0.0), name).data.lens = 60.0
    bpy.context.view_layer.update()
    above, below = ratios("six")
    assert above == pytest.approx(1.0, abs=0.06), "from above"
    if scene == "tile without a bottom":  # its inside is dark, and nobody is meant to look at it
        return
    assert below == pytest.approx(1.0, abs=0.06), "from below"
    if scene.startswith("plate"):
        assert ratios("one")[1] > 4.0, "the mean of both sides is no light of the lower one"


def test_two_lights_shine_on_both_sides_of_a_sheet() -> None:
    """A corrugated sheet, dark and white by turns, shows along the normals of the white slopes, or against them."""
    bpy.ops.wm.read_homefile(use_empty=True)
    for name, gray, slope in (("White", 0.8, 1), ("Dark", 0.1, -1)):
        paint = simple("BsdfPrincipled", name, Base_Color=(gray, gray, gray, 1.0))
        places, faces = [], []
        for x in np.arange(-1.0, 1.0, 0.02) + (0.0 if slope > 0 else 0.01):
            ends = (x, 0.0 if slope > 0 else 0.01), (x + 0.01, 0.01 if slope > 0 else 0.0)
            first = len(places)
            places += [(along, y, z) for along, z in ends for y in (-1.0, 1.0)]
            faces.append((first, first + 2, first + 3, first + 1))
        link(mesh(name, places, faces, paint))
    for name, way in (("Front", -1.0), ("Back", 1.0)):
        look_from((way, 0.0, -way), (0.0, 0.0, 0.0), name).data.lens = 60.0
    names, size = ("Front", "Back"), (16, 16)
    octree = lit(light="two-lights", depth=6, size=size, cameras=names, color=False).octree
    cameras = choose_cameras(bpy.context.evaluated_depsgraph_get(), names, size, np.zeros((2, 3)))
    front, back = (drain(supersample(octree, camera, 8)).luminance.mean() for camera in cameras)
    assert back == pytest.approx(front, rel=0.1)
