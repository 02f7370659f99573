# SPDX-License-Identifier: GPL-3.0-or-later
"""Light by direction against Cycles: things thinner than a voxel from above and from below, however normals point."""

from collections.abc import Callable

import bpy
import pytest

from patchnet.operators.settings.job_settings import JobSettings
from patchnet.operators.verify_light import CheckSettings, verify_light
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.tests.blender import shaders
from patchnet.tests.blender.objects import CUBE_FACES, lamp, link, look_from, mesh
from patchnet.tests.blender.shaders import simple

INWARD = [tuple(reversed(face)) for face in CUBE_FACES]
BOTTOM = next(face for face in CUBE_FACES if all(not corner & 1 for corner in face))  # of `box`: z is its lowest bit


def box(name: str, low: float, high: float, gray: float, faces: list[tuple[int, ...]]) -> None:
    paint = simple("BsdfPrincipled", name, Base_Color=(gray, gray, gray, 1.0))
    corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (low, high)]
    link(mesh(name, corners, faces, paint))


def cloth_on_table() -> None:
    box("Table", -0.03, 0.0, 0.02, CUBE_FACES)
    paint = simple("BsdfPrincipled", "Cloth", Base_Color=(0.8, 0.8, 0.8, 1.0))
    link(mesh("Cloth", [(-1, -1, 0.007), (1, -1, 0.007), (1, 1, 0.007), (-1, 1, 0.007)], [(0, 1, 2, 3)], paint))


SCENES: dict[str, Callable[[], None]] = {
    "plate": lambda: box("Plate", 0.0, 0.01, 0.6, CUBE_FACES),
    "plate inside out": lambda: box("Plate", 0.0, 0.01, 0.6, INWARD),
    "tile without a bottom": lambda: box("Tile", 0.0, 0.01, 0.6, [face for face in CUBE_FACES if face != BOTTOM]),
    "cloth on a table": cloth_on_table,
}


def ratios(sides: str) -> list[float]:
    """Mean luminance over that of Cycles, from above and from below."""
    job = JobSettings.of(
        depth=6, size=(24, 24), samples=32, cameras=("Above", "Below"), sides=sides, color=False, texel_voxels=1.0
    )
    check = drain(verify_light(bpy.context, CheckSettings(job, render_samples=64, rays=8)))
    return [camera["mean_ratio"] for camera in check.report["cameras"]]


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
