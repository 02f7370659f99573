# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays that end on the surface against Cycles: thin bars, a cut-out card, a texture finer than voxels, both sides."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet.operators.pipeline.run import run_job
from patchnet.operators.pipeline.unfinished import STAND_IN
from patchnet.operators.settings.job_settings import JobSettings
from patchnet.patchnet_addon.image.unfinished import Unfinished
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.tests.blender import shaders
from patchnet.tests.blender.light_scene import checked, mean_ratios
from patchnet.tests.blender.objects import SQUARE, lamp, link, look_from, mesh
from patchnet.tests.blender.shaders import image, material, mixed, shader, shown, simple


def textured(name: str, pixels: np.ndarray, *, cut: bool) -> bpy.types.Material:
    """Diffuse material of an image, with its alpha as cut-out."""
    paint, tree = material(name)
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = image(name, pixels)
    node.image.pack()
    diffuse = shader(tree, "BsdfDiffuse")
    tree.links.new(node.outputs["Color"], diffuse.node.inputs["Color"])
    if cut:
        alpha = mixed(tree, shader(tree, "BsdfTransparent"), diffuse, 0.5)
        tree.links.new(node.outputs["Alpha"], alpha.node.inputs[0])
        diffuse = alpha
    shown(tree, diffuse)
    return paint


def plate(
    name: str, corners: list[tuple[float, float, float]], paint: bpy.types.Material, repeats: float = 1.0
) -> None:
    item = link(mesh(name, corners, [(0, 1, 2, 3)], paint))
    uvs = repeats * np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32)
    item.data.uv_layers.new(name="UVMap").uv.foreach_set("vector", uvs.ravel())


@pytest.fixture
def fence(empty_scene: None) -> None:
    """Bars a quarter of a voxel wide, a card with a disc, a chequered floor of squares half a voxel wide."""
    checks = np.indices((64, 64)).sum(axis=0) % 2 * 0.7 + 0.1
    floor = np.dstack([checks, 0.6 * checks, 0.3 * checks, np.ones((64, 64))])
    plate("Floor", SQUARE, textured("Checks", floor, cut=False))
    y, x = (np.mgrid[0:64, 0:64] + 0.5) / 64 - 0.5
    disc = (np.hypot(x, y) < 0.35).astype(float)
    plate("Card", [(-0.9, 0.5, 0.0), (0.0, 0.5, 0.0), (0.0, 0.5, 0.9), (-0.9, 0.5, 0.9)],
          textured("Disc", np.dstack([0.8 * disc, 0.3 * disc, 0.2 * disc, disc]), cut=True))  # fmt: skip
    paint = simple("BsdfDiffuse", "Iron", Color=(0.05, 0.05, 0.05, 1.0))
    for x in np.linspace(0.05, 0.95, 10):
        wide, low = 0.004, float(x)
        corners = [(low, -0.3, 0.0), (low + 2 * wide, -0.3, 0.0), (low + 2 * wide, -0.3, 0.8), (low, -0.3, 0.8)]
        link(mesh("Bar", corners, [(0, 1, 2, 3)], paint))
    shaders.world().nodes["Background"].inputs["Color"].default_value = (0.5, 0.5, 0.5, 1.0)
    lamp("SUN", 2.0, (0.5, -2.0, 3.0), angle=0.2)
    look_from((0.4, -2.2, 1.2), (0.0, 0.0, 0.3), "Eye")
    bpy.context.view_layer.update()


def test_pictures_are_those_of_cycles(fence: None) -> None:
    found = {}
    for shape in ("whole", "boxes", "exact"):
        settings = {"depth": 7, "cameras": ("Eye",), "size": (160, 120), "max_samples": 32, "color": False}
        found[shape] = checked(**settings, shape=shape).report["mean"]
    psnr = {shape: report["psnr_db"] for shape, report in found.items()}
    assert psnr["exact"] > max(psnr["boxes"] + 4.0, 30.0) and psnr["boxes"] > psnr["whole"] + 0.5, psnr
    assert found["exact"]["mean_ratio"] == pytest.approx(1.0, abs=0.02)


def test_light_beside_thin_lines_of_a_texture(empty_scene: None) -> None:
    """Surfels that meet dark lines, and those beside them, are divided by base colours that are not quite theirs.

    Lines of a texel, 1.5 to 3 of which are a voxel wide: in step with the voxels or not, a single width may err.
    """
    lines = np.where((np.indices((128, 128)) % 8 == 0).any(axis=0), 0.02, 0.8)
    paint = textured("Lines", np.dstack([lines, lines, lines, np.ones_like(lines)]), cut=False)
    shaders.world().nodes["Background"].inputs["Color"].default_value = (0.5, 0.5, 0.5, 1.0)
    look_from((0.4, -1.2, 1.6), (0.0, 0.0, 0.0), "Eye")
    found = []
    for repeats in (0.97, 1.0, 1.13, 1.31, 1.57, 2.03):
        bpy.data.batch_remove([item for item in bpy.data.objects if item.type == "MESH"])
        plate("Floor", SQUARE, paint, repeats)
        found += mean_ratios(cameras=("Eye",), size=(64, 48), max_samples=32)
    assert found == pytest.approx([1.0] * len(found), abs=0.055) and np.mean(found) == pytest.approx(1.0, abs=0.01)


def test_a_job_shows_textured_objects_before_their_light(fence: None, weights: Path) -> None:
    seen: list[Unfinished] = []
    settings = JobSettings.of(depth=5, cameras=("Eye",), size=(16, 12), max_samples=2, weights=weights)
    drain(run_job(bpy.context, settings, seen.append))
    assert seen[0].title == STAND_IN and seen[0].picture.max() > 0.0
