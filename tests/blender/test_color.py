# SPDX-License-Identifier: GPL-3.0-or-later
"""Colour from scene to picture against Cycles; luminance is the same without colour."""

from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet.patchnet_addon.octree.file import octree_arrays
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.sampling.registry import STRATEGIES
from patchnet.patchnet_addon.sampling.trace import trace_view
from patchnet.tests.blender.job_scene import box, render_by_cycles
from patchnet.tests.blender.light_scene import lit
from patchnet.tests.blender.objects import active_camera, lamp, look_from
from patchnet.tests.blender.shaders import image, read_by

pytestmark = pytest.mark.usefixtures("registered")

SIZE = (48, 32)
WALLS = {"red": (0.8, 0.05, 0.05), "green": (0.1, 0.6, 0.1), "stripes": (1.0, 1.0, 1.0)}


@pytest.fixture(autouse=True)
def scene() -> bpy.types.Scene:
    """Two walls of one colour, one with a fine texture of orange and blue, and a white floor that they shine on."""
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    for index, (name, color) in enumerate(WALLS.items()):
        wall = box(name, (index - 1.5, 0.0, 0.0), (index - 0.5, 0.1, 1.0), 0.5)
        shader = wall.active_material.node_tree.nodes["Principled BSDF"]
        shader.inputs["Base Color"].default_value = (*color, 1.0)
        shader.inputs["Specular IOR Level"].default_value = 0.0
        if name == "stripes":
            stripe(wall, shader)
    box("floor", (-1.5, -1.5, -0.1), (1.5, 0.1, 0.0), 0.8)
    lamp("SUN", 3.0).rotation_euler = (0.9, 0.0, 0.1)
    look_from((0.0, -4.0, 1.2), (0.0, 0.0, 0.3))
    bpy.context.view_layer.update()
    return scene


def stripe(wall: bpy.types.Object, shader: bpy.types.Node) -> None:
    """Four columns of texels of each colour along the wall."""
    pixels = np.ones((8, 8, 4), np.float32)
    pixels[:, 0::2, :3], pixels[:, 1::2, :3] = (0.9, 0.4, 0.05), (0.05, 0.2, 0.8)
    texture = image("stripes", pixels, data=True)
    texture.pack()
    layer = wall.data.uv_layers.new(name="UV")
    for loop in wall.data.loops:
        corner = wall.data.vertices[loop.vertex_index].co
        layer.data[loop.index].uv = (corner.x - 0.5, corner.z)
    tree = shader.id_data
    color = read_by("TexImage", image=texture, interpolation="Linear")
    tree.links.new(color(tree), shader.inputs["Base Color"])


def regions() -> dict[str, np.ndarray]:
    """Pixels (H, W) that show each object, well inside of it, by Blender's ray casts."""
    scene = bpy.context.scene
    depsgraph = bpy.context.evaluated_depsgraph_get()
    camera = scene.camera
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    frame = [camera.matrix_world @ corner for corner in camera.data.view_frame(scene=scene)]
    origin, (right_top, right_low, left_low, left_top) = camera.matrix_world.translation, frame
    names = np.full(SIZE[::-1], "", object)
    for row, column in np.ndindex(*names.shape):
        low = left_low.lerp(right_low, (column + 0.5) / SIZE[0])
        point = low.lerp(left_top.lerp(right_top, (column + 0.5) / SIZE[0]), (row + 0.5) / SIZE[1])
        hit, _, _, _, item, _ = scene.ray_cast(depsgraph, origin, point - origin)
        names[row, column] = item.name if hit else ""
    inside = np.zeros(names.shape, bool)
    inside[1:-1, 1:-1] = True
    for axis in (0, 1):
        for step in (-1, 1):
            inside &= np.roll(names, step, axis) == names
    return {name: inside & (names == name) for name in (*WALLS, "floor")}


@pytest.mark.parametrize("light", ["cycles", "two-lights"])
def test_luminance_is_the_same_with_and_without_colour(light: str) -> None:
    gray, colored = (lit(depth=6, light=light, max_samples=2, color=color).octree for color in (False, True))
    assert gray.chroma is None and colored.chroma is not None
    assert (gray.provenance["color"], colored.provenance["color"]) == (False, True)
    assert gray.exposure == colored.exposure
    for name, values in octree_arrays(gray).items():
        if name != "bright_colors" and not name.startswith("piece_"):
            np.testing.assert_array_equal(octree_arrays(colored)[name], values, err_msg=name)


def test_pictures_agree_with_cycles_in_each_region(tmp_path: Path) -> None:
    octree = lit(depth=7, max_samples=64, color=True).octree
    buffers = drain(trace_view(octree, active_camera(SIZE), [STRATEGIES["optimal"]]))
    assert buffers.preview_color is not None and buffers.reference_color is not None
    cycles = render_by_cycles(tmp_path / "cycles.exr", SIZE, 256)[..., :3] * octree.exposure
    for colors in (buffers.preview_color, buffers.reference_color):
        picture = buffers.picture(colors)
        for name, chosen in regions().items():
            assert chosen.sum() > 30, name
            mine, its = picture[chosen].mean(axis=0), cycles[chosen].mean(axis=0)
            np.testing.assert_allclose(mine, its, rtol=0.08, atol=0.012, err_msg=name)
    floor = buffers.picture(buffers.reference_color)[regions()["floor"]].mean(axis=0)
    assert floor[0] > 1.02 * floor[2], "the red wall shines on the floor"


def test_fine_texture_keeps_its_colours() -> None:
    """Light cells as large as stripes: voxels show the stripes' own colours."""
    octree = lit(depth=7, max_samples=16, color=True, size=(12, 8)).octree
    level = octree.depth
    centres = octree.grid.to_world((octree.cells(level) + 0.5) / (1 << level))
    x, y, z = centres.T
    front = (x > 0.55) & (x < 1.45) & (np.abs(y) < octree.grid.voxel_size_world / 2) & (z > 0.2) & (z < 0.8)
    place = ((x - 0.5) * 8) % 2
    colors = octree.color_float(octree.level(level))
    for here, hue in ((np.abs(place - 0.5) < 0.1, (0.9, 0.4, 0.05)), (np.abs(place - 1.5) < 0.1, (0.05, 0.2, 0.8))):
        mean = colors[front & here].mean(axis=0)
        # What texture does to light is limited to a factor of 4, so that a little of the other colour stays.
        np.testing.assert_allclose(mean / mean.sum(), np.array(hue) / sum(hue), atol=0.08)
