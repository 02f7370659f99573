# SPDX-License-Identifier: GPL-3.0-or-later
"""Importance by images and vertex groups, in operators and on the command line."""

import json
from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet.commands import main
from patchnet.operators.importance.painted import Importance
from patchnet.operators.importance.pixels import importance_key
from patchnet.operators.pipeline.views import View
from patchnet.operators.session.views import image_name
from patchnet.patchnet_addon.sampling.refine import refined_mask, refinement_order
from patchnet.tests.blender.job_scene import SMALL, pixels_of, ran, saved
from patchnet.tests.blender.shaders import image

pytestmark = pytest.mark.usefixtures("scene")

WIDTH, HEIGHT = SMALL["size"]


def look(weights: Path, importance: Importance | None, **values: object) -> View:
    settings = {"light": "two-lights", "weights": weights, **SMALL, "importance": importance, "reference": True}
    return ran(**settings | values).views[0]


def painted(name: str = "Mask", size: tuple[int, int] = (WIDTH, HEIGHT)) -> bpy.types.Image:
    """The left half white, the rest black."""
    pixels = np.zeros((size[1], size[0], 4), np.float32)
    pixels[..., 3] = 1.0
    pixels[:, : size[0] // 2, :3] = 1.0
    return image(name, pixels, float_buffer=False)


def test_image(weights: Path) -> None:
    painted(size=(4 * WIDTH, 4 * HEIGHT))
    plain, masked = look(weights, None), look(weights, Importance(image="Mask"))
    left = np.arange(WIDTH) < WIDTH // 2
    assert plain.priority[:, ~left].max() > 0
    np.testing.assert_array_equal(masked.priority[:, left][:, :-1], plain.priority[:, left][:, :-1])
    assert not masked.priority[:, ~left][:, 1:].any()
    buffers = masked.buffers
    order = refined_mask(buffers, refinement_order(buffers, plain.priority.ravel()), 0.3).reshape(HEIGHT, WIDTH)
    assert order[:, left].any() and not order[:, ~left][:, 1:].any()
    counted = masked.report["refinable_pixels"]
    assert 0 < counted < masked.report["active_pixels"] == plain.report["active_pixels"]
    assert masked.report["mse_unrefined"] == pytest.approx(plain.report["mse_unrefined"])
    assert masked.report["mse"]["optimal"] >= plain.report["mse"]["optimal"]


def test_row_0_of_an_image_is_the_lowest_of_the_picture(weights: Path) -> None:
    mask = painted()
    pixels = np.zeros((HEIGHT, WIDTH, 4), np.float32)
    pixels[: HEIGHT // 2] = 1.0
    mask.pixels.foreach_set(pixels.ravel())
    masked = look(weights, Importance(image="Mask"))
    assert masked.priority[: HEIGHT // 2].any() and not masked.priority[HEIGHT // 2 :].any()


def group(name: str, weight: float, item: str = "Slab") -> None:
    target = bpy.data.objects[item]
    target.vertex_groups.new(name=name).add(range(len(target.data.vertices)), weight, "REPLACE")


def test_weights_are_interpolated_and_go_with_the_object(weights: Path) -> None:
    slab = bpy.data.objects["Slab"]
    group("Matters", 0.0)
    right = [vertex.index for vertex in slab.data.vertices if vertex.co.x > 0]
    slab.vertex_groups["Matters"].add(right, 1.0, "REPLACE")
    slab.location.x = 0.4
    bpy.context.view_layer.update()
    importance = Importance(vertex_group="Matters")
    result = ran(light="two-lights", weights=weights, scope="SELECTED", importance=importance, **SMALL)
    said = result.report["settings"]
    assert (said["importance"], said["importance_group"]) == ("VERTEX_GROUP", "Matters") and "spp" in said
    assert said["size"] == [WIDTH, HEIGHT] and "importance_image" not in said
    buffers, grid = result.views[0].buffers, result.coded.octree.grid
    hit = np.flatnonzero(buffers.hit)
    sides = np.exp2(-buffers.hits.level[hit].astype(float))[:, None]
    x = grid.to_world((buffers.hits.cell[hit] + 0.5) * sides)[:, 0]
    expected = np.clip((x + 0.6) / 2.0, 0.0, 1.0)  # the slab reaches from -0.6 to 1.4 now
    assert np.abs(buffers.importance[hit] - expected).max() < 0.05
    assert np.ptp(expected) > 0.5


def test_operators_use_the_setting() -> None:
    settings = bpy.context.scene.patchnet
    settings.importance = "IMAGE"
    with pytest.raises(RuntimeError, match="needs a painted image: choose one"):
        bpy.ops.patchnet.run_all(light="two-lights", **SMALL)
    painted()
    settings.importance_image = "Mask"
    assert bpy.ops.patchnet.run_all(light="two-lights", **SMALL) == {"FINISHED"}
    shown = pixels_of(bpy.data.images[image_name("Eye", "priority")])[..., 0]
    assert shown[:, : WIDTH // 2].any() and not shown[:, WIDTH // 2 + 1 :].any()


def test_strokes_count_for_frames(tmp_path: Path) -> None:
    painted()
    group("Matters", 0.5)
    first = [importance_key(Importance(image="Mask")), importance_key(Importance(vertex_group="Matters"))]
    assert first == [importance_key(Importance(image="Mask")), importance_key(Importance(vertex_group="Matters"))]
    bpy.data.images["Mask"].pixels[0] = 0.3
    bpy.data.objects["Slab"].vertex_groups["Matters"].add([0], 0.6, "REPLACE")
    second = [importance_key(Importance(image="Mask")), importance_key(Importance(vertex_group="Matters"))]
    assert all(one != other for one, other in zip(first, second, strict=True))


def test_command_line(weights: Path, tmp_path: Path) -> None:
    mask = painted()
    mask.pack()
    mask.use_fake_user = True
    scene = saved(tmp_path / "scene.blend")
    arguments = ["run", str(scene), "--light", "two-lights", "--weights", str(weights)]
    arguments += ["--depth", "7", "--size", str(WIDTH), str(HEIGHT), "--out", str(tmp_path / "out")]
    assert main([*arguments, "--mask-image", "Mask"]) == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    (view,) = report["frames"]
    assert 0 < view["refinable_pixels"] < view["active_pixels"]
    assert main([*arguments, "--mask-image", "None"]) == 2
