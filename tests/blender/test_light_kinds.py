# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps, worlds, emitters, panes and mixed materials: the bake agrees with a render."""

from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from patchnet.tests.blender.light_scene import assert_agrees, compare
from patchnet.tests.blender.objects import lamp, pane, slab
from patchnet.tests.blender.shaders import grey, image, material, mixed, read_by, shader, shown, simple, world

pytestmark = pytest.mark.usefixtures("empty_scene")


@pytest.mark.parametrize(
    ("kind", "settings"),
    [
        ("POINT", {"shadow_soft_size": 0.1}),
        ("AREA", {"size": 0.6, "spread": 0.6}),
        ("AREA", {"shape": "DISK", "size": 0.8}),
        ("SPOT", {"spot_size": 1.0, "spot_blend": 0.1, "shadow_soft_size": 0.02}),
    ],
)
def test_lamps(kind: str, settings: dict) -> None:
    """The edge of the spot's cone, and the area's narrow beam, lie on the surface."""
    slab()
    lamp(kind, 20.0, (0.2, 0.1, 1.0), **settings)
    assert_agrees(compare(), contrast=0.5)


def test_sky_texture() -> None:
    """The newest kind that this Blender has, sun disc included."""
    slab()
    pane("Roof", grey(0.0), scale=(1, 1, 1))
    tree = world()
    sky = tree.nodes.new("ShaderNodeTexSky")
    assert sky.sky_type in ("NISHITA", "MULTIPLE_SCATTERING", "SINGLE_SCATTERING")
    sky.sun_elevation, sky.sun_intensity = 0.9, 0.1
    tree.links.new(sky.outputs[0], tree.nodes["Background"].inputs["Color"])
    assert_agrees(compare(256), contrast=0.3)


def test_environment_picture(tmp_path: Path) -> None:
    """A bright spot near the horizon on a dim sky, from a file."""
    sky = np.full((32, 64, 4), 0.1, np.float32)
    sky[22:26, 40:46, :3] = (60.0, 30.0, 10.0)
    picture = image("Sky", sky)
    picture.filepath_raw = str(tmp_path / "sky.hdr")
    picture.file_format = "HDR"
    picture.save()
    slab()
    wall = pane("Wall", grey(0.0))
    wall.rotation_euler, wall.location = (0.0, np.pi / 2, 0.0), (0.0, 0.0, 1.0)
    tree = world()
    loaded = bpy.data.images.load(picture.filepath_raw)
    tree.links.new(read_by("TexEnvironment", image=loaded)(tree), tree.nodes["Background"].inputs["Color"])
    assert_agrees(compare(512), contrast=0.3)


@pytest.mark.parametrize("method", ["REPLACE", "ADD"])
def test_fast_gi(method: str) -> None:
    """What it adds is in no pass of diffuse light."""
    slab()
    pane("Roof", grey())
    world()
    cycles, light = bpy.context.scene.cycles, bpy.context.scene.world.light_settings
    cycles.use_fast_gi, cycles.fast_gi_method, light.distance, light.ao_factor = True, method, 1.0, 0.7
    assert_agrees(compare(256), contrast=0.1)


def transparent_pane(kind: str) -> bpy.types.Material:
    """Materials that let light through, each in its way."""
    if kind == "holes":
        result, tree = material("Holes")
        checker = tree.nodes.new("ShaderNodeTexChecker")
        checker.inputs["Scale"].default_value = 4.0
        mix = mixed(tree, shader(tree, "BsdfTransparent"), shader(tree, "BsdfDiffuse"), 0.5)
        tree.links.new(tree.nodes.new("ShaderNodeTexCoord").outputs["Generated"], checker.inputs["Vector"])
        tree.links.new(checker.outputs["Fac"] if "Fac" in checker.outputs else checker.outputs[1], mix.node.inputs[0])
        shown(tree, mix)
        return result
    shader_name, inputs = {
        "alpha": ("BsdfPrincipled", {"Alpha": 0.3}),
        "tinted": ("BsdfTransparent", {"Color": (0.2, 0.6, 0.9, 1.0)}),
        "translucent": ("BsdfTranslucent", {"Color": (0.8, 0.8, 0.8, 1.0)}),
        "glass": ("BsdfGlass", {"IOR": 1.45, "Roughness": 0.0}),
        "refraction": ("BsdfRefraction", {"IOR": 1.3, "Roughness": 0.2}),
        "transmission": ("BsdfPrincipled", {"Transmission_Weight": 1.0, "Roughness": 0.3}),
    }[kind]
    return simple(shader_name, kind, **inputs)


@pytest.mark.parametrize("kind", ["holes", "alpha", "tinted", "translucent"])
def test_light_through_panes(kind: str) -> None:
    slab()
    pane("Pane", transparent_pane(kind))
    lamp("SUN", 3.0, angle=0.05)
    assert_agrees(compare(256), contrast=0.1)


def test_a_lamp_in_a_translucent_body() -> None:
    """Light from behind the surface, which the surface itself must not keep off."""
    slab(paint=transparent_pane("translucent")).data.transform(Matrix.Diagonal((1, 1, 4, 1)))
    lamp("POINT", 5.0, (-0.5, 0.0, -0.5), shadow_soft_size=0.1)
    assert_agrees(compare(), contrast=0.5)


def test_translucent_leaves() -> None:
    """Two shaders in a group; the sides get the same light, for a picture shows one of them."""
    paint, tree = material("Leaf")
    group = bpy.data.node_groups.new("Leaf", "ShaderNodeTree")
    group.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    green = shader(group, "BsdfTranslucent", Color=(0.3, 0.9, 0.3, 1.0))
    sides = mixed(group, shader(group, "BsdfDiffuse", Color=(0.2, 0.2, 0.2, 1.0)), green, 0.7)
    group.links.new(sides, group.nodes.new("NodeGroupOutput").inputs[0])
    shown(tree, read_by("Group", 0, node_tree=group)(tree))
    pane("Leaf", paint, 0.0).location.x = 0.0
    for z in (0.5, -0.5):
        pane("Roof", grey(0.0), z)
        lamp("SUN", 2.0, angle=0.1).rotation_euler.x = np.pi * (z < 0.0)
    assert_agrees(compare(256, names=("Leaf",)), contrast=0.8)  # 128 on each side


@pytest.mark.parametrize(
    ("kind", "source"), [("glass", "world"), ("glass", "lamp"), ("refraction", "world"), ("transmission", "lamp")]
)
def test_light_through_transmission(kind: str, source: str) -> None:
    """Paths that leave the surface, pass the pane and meet a large lamp or the world: caustics, as the settings say."""
    slab()
    pane("Pane", transparent_pane(kind))
    if source == "world":
        world()
    else:
        lamp("AREA", 200.0, (0, 0, 2), size=4.0)
    assert_agrees(compare(512 if source == "world" else 768), contrast=0.05)
