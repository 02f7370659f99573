# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials found in files of other people, compared with Cycles from the same camera."""

from collections.abc import Callable

import bpy
import numpy as np
import pytest

from patchnet.operators.verify_light import LightCheck
from patchnet.tests.blender.light_scene import assert_as_cycles, checked
from patchnet.tests.blender.objects import lamp, look_from
from patchnet.tests.blender.shaders import image, material, shader, shown, simple, world

pytestmark = pytest.mark.usefixtures("empty_scene")

RIGHT_DB, RIGHT_RATIO = 21.0, 0.06


def around(
    target: tuple[float, float, float], place: tuple[float, float, float] = (4.0, -6.0, 5.0), ground: bool = True
) -> None:
    """Ground, sun, sky, and a camera that looks at a point."""
    if ground:
        bpy.ops.mesh.primitive_plane_add(size=12.0)
        bpy.context.object.data.materials.append(simple(name="Ground", Color=(0.6, 0.6, 0.6, 1)))
    lamp("SUN", 3.0).rotation_euler = (0.7, 0.2, 0.5)
    world().nodes["Background"].inputs[0].default_value = (0.3, 0.36, 0.48, 1)
    look_from(place, target)


def cube(paint: bpy.types.Material, x: float, y: float = 0.0) -> bpy.types.Object:
    bpy.ops.mesh.primitive_cube_add(size=2.0, location=(x, y, 1.0))
    bpy.context.object.data.materials.append(paint)
    return bpy.context.object


def principled(name: str, **inputs: object) -> bpy.types.Material:
    values = {"Base_Color": (0.8, 0.3, 0.2, 1), "Roughness": 1.0, "Specular_IOR_Level": 0.0}
    return simple("BsdfPrincipled", name, **values | inputs)


def compared(**values: object) -> LightCheck:
    settings = {"depth": 7, "size": (96, 96), "max_samples": 4, "cameras": ("Eye",), "gloss": "off"} | values
    return checked(render_samples=16, rays=6, **settings)


def without_output() -> None:
    """A material for EEVEE alone, one without nodes in its tree, and one whose output has no surface."""
    around((0, 0, 0.5))
    eevee, _ = material("EEVEE")
    eevee.node_tree.nodes[0].target = "EEVEE"
    empty, tree = material("Empty")
    tree.nodes.clear()
    for number, paint in enumerate((eevee, empty, material("No surface")[0])):
        cube(paint, 3.0 * number - 3.0)


def without_nodes() -> None:
    """Materials of old files, whose viewport colour has alpha."""
    around((0, 0, 0.5))
    for number, alpha in enumerate((1.0, 0.3, 0.0)):
        paint = bpy.data.materials.new(f"Old {alpha}")
        paint.use_nodes = False
        paint.diffuse_color = (0.8, 0.3, 0.1, alpha)
        cube(paint, 3.0 * number - 3.0)


def textured(extension: str = "REPEAT", interpolation: str = "Linear", uv_map: str = "") -> None:
    """A wall whose texture is repeated, clipped or mirrored, on the map of its own node; its alpha is not linked."""
    around((0, 0, 1.0), (0.0, -5.0, 2.0))
    paint, tree = material("Wall")
    diffuse = shader(tree, "BsdfDiffuse")
    picture, uvs = tree.nodes.new("ShaderNodeTexImage"), tree.nodes.new("ShaderNodeUVMap")
    rng = np.random.default_rng(3)
    picture.image = image("Picture", np.dstack([rng.uniform(0.1, 0.9, (4, 4, 3)), np.ones((4, 4))]), data=True)
    picture.extension, picture.interpolation, uvs.uv_map = extension, interpolation, uv_map
    tree.links.new(uvs.outputs[0], picture.inputs["Vector"])
    tree.links.new(picture.outputs["Color"], diffuse.node.inputs["Color"])
    shown(tree, diffuse)
    wall = cube(paint, 0.0)
    wall.scale = (1.5, 0.1, 1.0)
    own = np.array([value for loop in wall.data.uv_layers[0].uv for value in loop.vector], np.float32)
    wall.data.uv_layers[0].uv.foreach_set("vector", (own * 4.0 - 1.5) if not uv_map else np.zeros_like(own))
    if uv_map:
        wall.data.uv_layers.new(name=uv_map).uv.foreach_set("vector", own * 4.0 - 1.5)


def partly_transparent() -> None:
    """Panes of even opacity over the ground."""
    around((0, 0, 0.5))
    for number, alpha in enumerate((0.1, 0.3, 0.7, 0.9)):
        bpy.ops.mesh.primitive_plane_add(size=1.6, location=(1.8 * number - 2.7, 0.0, 0.5))
        bpy.context.object.data.materials.append(principled(f"Pane {alpha}", Alpha=alpha))


SCENES: dict[str, Callable[[], None]] = {
    "materials without an output": without_output,
    "materials without nodes": without_nodes,
    "clipped texture": lambda: textured("CLIP"),
    "mirrored texture": lambda: textured("MIRROR"),
    "partly transparent panes": partly_transparent,
}


@pytest.mark.parametrize("name", SCENES)
def test_light_is_that_of_cycles(name: str) -> None:
    SCENES[name]()
    check = compared()
    assert_as_cycles(check, RIGHT_DB, RIGHT_RATIO)
    named = "Materials 'Pane 0.1', 'Pane 0.3', 'Pane 0.7', 'Pane 0.9' are partly transparent"
    said = [text for text in check.report["warnings"] if text.startswith(named)]
    assert len(said) == (SCENES[name] is partly_transparent)


@pytest.mark.parametrize("kind", ["square texels", "second UV map"])
def test_texture_is_finer_than_the_light(kind: str) -> None:
    """With cells of light that are as large as its texels, which are then the material's alone."""
    textured("REPEAT", "Closest", "" if kind == "square texels" else "Second")
    assert_as_cycles(compared(size=(24, 24), depth=9), RIGHT_DB, RIGHT_RATIO)


def test_what_passes_light_is_not_black_whatever_its_specular() -> None:
    """As importers make of glass in OBJ and glTF files, with all light compared."""
    around((0, 0, 1.5), (0.0, -16.0, 4.0), ground=False)
    for number, specular in enumerate((0.0, 0.5)):
        color = (0.8, 0.8, 0.8, 1.0)
        values = {"Base_Color": color, "Specular_IOR_Level": specular, "Roughness": 0.4, "Transmission_Weight": 1.0}
        cube(principled(f"Glass {specular}", **values), 3.0 * number - 1.5)
    check = compared(gloss="auto", max_samples=16)
    (figures,) = check.report["cameras"]
    assert figures["psnr_db"] > 30.0 and 0.85 < figures["mean_ratio"] < 1.0, "0.45 and 20 dB where one of them is black"
    (warning,) = check.report["warnings"]
    assert "'Glass 0.0', 'Glass 0.5'" in warning and "shines through" in warning
