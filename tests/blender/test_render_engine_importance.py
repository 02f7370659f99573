# SPDX-License-Identifier: GPL-3.0-or-later
"""Painted importance in renders of the engine: what is refined, what ranks, what is said where nothing is painted."""

from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet.operators.session import results
from patchnet.tests.blender.engine_scene import HEIGHT, WIDTH, build_for_engine, rendered

HALF = WIDTH // 2


@pytest.fixture(autouse=True)
def scene(registered: None, weights: Path, tmp_path: Path) -> bpy.types.Scene:
    return build_for_engine(weights, tmp_path)


def passes(scene: bpy.types.Scene) -> dict[str, np.ndarray]:
    """The passes (H, W) of a still, of one channel each."""
    return {name: values[..., 0] for name, values in rendered(scene).items() if values.shape[-1] == 1}


def painted(scene: bpy.types.Scene, values: np.ndarray, name: str = "Mask") -> None:
    """An image of gray `values` (h, w), row 0 at the bottom, chosen as importance."""
    image = bpy.data.images.new(name, values.shape[1], values.shape[0], float_buffer=True)
    pixels = np.ones((*values.shape, 4), np.float32)
    pixels[..., :3] = values[..., None]
    image.pixels.foreach_set(pixels.ravel())
    scene.patchnet.importance, scene.patchnet.importance_image = "IMAGE", name


def left_half(gray: float = 1.0) -> np.ndarray:
    values = np.zeros((HEIGHT, WIDTH), np.float32)
    values[:, :HALF] = gray
    return values


def test_black_is_never_refined_and_budgets_count_all_active_pixels(scene: bpy.types.Scene) -> None:
    scene.patchnet.budget = 0.3
    plain = passes(scene)
    painted(scene, left_half())
    masked = passes(scene)
    assert (plain["Sample Count"][:, HALF:] == 1024).any()
    assert (masked["Sample Count"][:, HALF:] == 1).all()
    assert np.array_equal(masked["Priority"], plain["Priority"] * left_half())
    assert (masked["Sample Count"] == 1024).sum() == (plain["Sample Count"] == 1024).sum()
    scene.patchnet.budget = 1.0  # pays for more than what is white
    assert (passes(scene)["Sample Count"][:, HALF:] == 1).all()


@pytest.mark.parametrize("crop", [False, True])
def test_a_border_cuts_the_mask_as_it_cuts_the_picture(scene: bpy.types.Scene, crop: bool) -> None:
    painted(scene, np.random.default_rng(4).random((HEIGHT, WIDTH)).astype(np.float32))
    whole = passes(scene)["Priority"]
    render = scene.render
    render.use_border, render.use_crop_to_border = True, crop
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.2, 0.71, 0.13, 0.8
    columns, rows = slice(int(0.2 * WIDTH), int(0.71 * WIDTH)), slice(int(0.13 * HEIGHT), int(0.8 * HEIGHT))
    part = passes(scene)["Priority"]
    inside = part if crop else part[rows, columns]
    np.testing.assert_allclose(inside, whole[rows, columns], rtol=1e-4, atol=1e-5)
    assert whole[rows, columns].any()


def test_a_vertex_group_follows_the_object_and_its_modifiers(scene: bpy.types.Scene) -> None:
    """With a weight of a half; what is off in viewports is painted in renders nevertheless."""
    plain = passes(scene)
    slab = scene.objects["Slab"]
    slab.vertex_groups.new(name="Matters").add(range(len(slab.data.vertices)), 0.5, "REPLACE")
    modifier = slab.modifiers.new("Shift", "DISPLACE")
    modifier.direction, modifier.mid_level, modifier.strength, modifier.show_viewport = "Y", 0.0, 0.4, False
    bpy.context.view_layer.update()
    moved = passes(scene)
    scene.patchnet.importance, scene.patchnet.importance_group = "VERTEX_GROUP", "Matters"
    scene.patchnet.budget = 1.0
    masked = passes(scene)
    assert not np.array_equal(plain["Depth"], moved["Depth"])
    behind = (masked["Depth"] > 5.3) & (masked["Level"] >= 0)
    before = masked["Depth"] < 5.0
    assert behind.any() and before.any()
    assert np.array_equal(masked["Priority"][behind], moved["Priority"][behind] * np.float32(0.5))
    assert not masked["Priority"][before].any() and (masked["Sample Count"][before] == 1).all()
    assert (masked["Sample Count"][behind] == 1024).all()


def test_what_is_not_there_is_said_before_anything_is_made(scene: bpy.types.Scene) -> None:
    scene.patchnet.importance, scene.patchnet.importance_image = "IMAGE", "Nobody"
    with pytest.raises(RuntimeError, match="There is no image 'Nobody' for the importance"):
        bpy.ops.render.render()
    scene.patchnet.importance, scene.patchnet.importance_group = "VERTEX_GROUP", "Nobody"
    with pytest.raises(RuntimeError, match="No voxelized object has the vertex group 'Nobody'"):
        bpy.ops.render.render()
    assert results.result_of(scene) is None
