# SPDX-License-Identifier: GPL-3.0-or-later
"""Opacity of materials: as much of a square is covered as in Cycles' picture of it; pictures are those of Cycles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import bpy
import numpy as np
import pytest

from patchnet.operators.scene.images import ImageReader
from patchnet.operators.scene.materials import read_material
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.voxelize import ClippedSurface
from patchnet.patchnet_addon.surface.texture_lookup import surface_of_fragments
from patchnet.patchnet_addon.surface.textures import TextureTable
from patchnet.tests.blender.light_scene import assert_as_cycles, checked, picture
from patchnet.tests.blender.objects import SQUARE, lamp, link, look_from, mesh, read
from patchnet.tests.blender.shaders import added, grey, image, material, mixed, read_by, shader, shown, world
from patchnet.tests.references.clip import parts_of

pytestmark = pytest.mark.usefixtures("empty_scene")

Tree, Socket = bpy.types.NodeTree, bpy.types.NodeSocket


def checks(tree: Tree, output: str = "Alpha") -> Socket:
    """An output of an image of 16 x 16 texels: squares of 0 and 1, a column of 1 on the right, in it alone."""
    if output not in bpy.data.images:
        y, x = np.mgrid[0:16, 0:16]
        filled = ((x // 4 + y // 4) % 2 == 1) | (x > 11)
        values = {"Alpha": (0.5, 0.5, 0.5, filled), "Color": (0.8 * filled, 0.6 * filled, 0.1 * filled, 1.0)}[output]
        pixels = np.dstack([np.broadcast_to(value, (16, 16)) for value in values])
        image(output, pixels).pack()
    return read_by("TexImage", output, image=bpy.data.images[output], interpolation="Closest")(tree)


def over(tree: Tree, factor: Socket | float, first: Socket, second: Socket) -> Socket:
    mix = mixed(tree, first, second, factor if isinstance(factor, float) else 0.5)
    if not isinstance(factor, float):
        tree.links.new(factor, mix.node.inputs[0])
    return mix


def clear(tree: Tree, *color: float) -> Socket:
    return shader(tree, "BsdfTransparent", **({"Color": (*color, 1.0)} if color else {}))


def paint(tree: Tree, alpha: float = 1.0) -> Socket:
    """Darker than the ground, so that no part of a pixel is clamped at white."""
    return shader(tree, "BsdfPrincipled", Alpha=alpha, Base_Color=(0.3, 0.2, 0.1, 1.0), Specular_IOR_Level=0.0)


def alone(tree: Tree) -> Socket:
    """Half of a mix without its other shader, which is black."""
    mix = tree.nodes.new("ShaderNodeMixShader")
    mix.inputs[0].default_value = 0.3
    tree.links.new(clear(tree), mix.inputs[2])
    return mix.outputs[0]


def number(tree: Tree, kind: str, *inputs: Socket | float | tuple[float, ...], **settings: str) -> Socket:
    node = read_by(kind, 0, **settings)(tree).node
    for value, end in zip(inputs, node.inputs, strict=False):
        if isinstance(value, bpy.types.NodeSocket):
            tree.links.new(value, end)
        else:
            end.default_value = value
    return node.outputs[0]


def through(tree: Tree, factor: Socket) -> Socket:
    """As opaque as a number says."""
    return over(tree, factor, clear(tree), paint(tree))


def attribute(tree: Tree, name: str, output: str | int = "Alpha", kind: str = "GEOMETRY") -> Socket:
    return read_by("Attribute", output, attribute_name=name, attribute_type=kind)(tree)


def color_attribute(tree: Tree, name: str, output: str) -> Socket:
    return read_by("VertexColor", output, layer_name=name)(tree)


def tinted_by_image(tree: Tree) -> Socket:
    tinted = clear(tree)
    tree.links.new(checks(tree, "Color"), tinted.node.inputs["Color"])
    return tinted


def cut(tree: Tree) -> Socket:
    return number(tree, "Math", checks(tree), 0.5, operation="GREATER_THAN")


OPACITIES: dict[str, Callable[[Tree], Socket]] = {
    "half of a cut-out": lambda t: over(t, 0.5, paint(t), through(t, checks(t))),
    "with a Principled of alpha 0": lambda t: over(t, 0.3, paint(t, 0.0), paint(t)),
    "transparent and a Principled of alpha": lambda t: over(t, 0.5, clear(t), paint(t, 0.6)),
    "by an image, of partial opacities": lambda t: over(t, checks(t), paint(t, 0.2), paint(t, 0.6)),
    "nested, one image twice": lambda t: over(t, 0.4, through(t, checks(t)), over(t, checks(t), paint(t), clear(t))),
    "a threshold times a number": lambda t: through(t, number(t, "Math", cut(t), 0.6, operation="MULTIPLY")),
    "one less a threshold": lambda t: through(t, number(t, "Math", 1.0, cut(t), operation="SUBTRACT")),
    "half of a threshold": lambda t: over(t, 0.5, clear(t), through(t, cut(t))),
    "a Mix node by an image": lambda t: through(t, number(t, "Mix", checks(t), (0.0,) * 3, 0.2, 0.9)),
    "transparent and emission": lambda t: added(t, clear(t), shader(t, "Emission")),
    "added halves": lambda t: added(t, over(t, 0.3, clear(t), paint(t)), over(t, 0.9, clear(t), paint(t))),
    "tinted": lambda t: clear(t, 0.2, 0.6, 0.2),
    "tinted by an image": tinted_by_image,
    "a mix without one shader": alone,
    "alpha of an attribute": lambda t: through(t, attribute(t, "Paint")),
    "factor of an attribute": lambda t: through(t, attribute(t, "Paint", 2)),
    "alpha of a color attribute": lambda t: through(t, color_attribute(t, "Paint", "Alpha")),
    "color attribute without a name": lambda t: through(t, color_attribute(t, "", "Color")),
    "green of a color attribute": lambda t: through(
        t, number(t, "SeparateColor", color_attribute(t, "Paint", "Color")).node.outputs[1]
    ),
    "threshold on an attribute": lambda t: through(
        t, number(t, "Math", attribute(t, "Paint"), 0.5, operation="GREATER_THAN")
    ),
    "a number without alpha": lambda t: through(t, attribute(t, "Weight")),
    "a number": lambda t: through(t, attribute(t, "Weight", 2)),
    "alpha of no attribute": lambda t: through(t, attribute(t, "Missing")),
    "alpha of no color attribute": lambda t: through(t, color_attribute(t, "Missing", "Alpha")),
    "alpha of the object": lambda t: through(t, attribute(t, "color", kind="OBJECT")),
    "color of the object": lambda t: through(t, number(t, "ObjectInfo").node.outputs["Color"]),
}


def square(shaders: Callable[[Tree], Socket], uv_map: bool = True) -> bpy.types.Object:
    """A square with a material, colours and numbers at its corners."""
    surface, tree = material("Paint")
    shown(tree, shaders(tree))
    item = link(mesh("Square", SQUARE, [(0, 1, 2, 3)], surface))
    if uv_map:
        uvs = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32)
        item.data.uv_layers.new(name="UVMap").uv.foreach_set("vector", uvs.ravel())
    colors = np.array([(0.1, 0.4, 0.7, 0.2), (0.3, 0.5, 0.6, 0.9), (0.9, 0.6, 0.2, 0.4), (0.2, 0.2, 0.8, 0.8)])
    made = item.data.color_attributes.new("Paint", "FLOAT_COLOR", "CORNER")
    made.data.foreach_set("color", colors.astype(np.float32).ravel())
    item.data.color_attributes.render_color_index = 0
    item.data.attributes.new("Weight", "FLOAT", "POINT").data.foreach_set("value", [0.1, 0.4, 0.7, 0.8])
    item.color = (0.2, 0.4, 0.8, 0.7)
    bpy.context.view_layer.update()
    return item


def covered() -> float:
    """Mean opacity of the square as the engine reads it, before what is less than half opaque is left out."""
    source = read()
    own = (read_material(bpy.data.materials["Paint"], ImageReader()).material,)
    clipped = ClippedSurface(replace(source, materials=own), Grid.around(source.bounds_world, 6))
    table, sums = TextureTable.from_materials(own), np.zeros(2)
    for batch, fragments in parts_of(clipped):
        opacity = surface_of_fragments(table, batch, fragments)[1]
        sums += fragments.area_world @ opacity, fragments.area_world.sum()
    return float(sums[0] / sums[1])


@pytest.mark.parametrize("name", OPACITIES)
def test_opacity_is_cycles_alpha(name: str) -> None:
    square(OPACITIES[name])
    assert covered() == pytest.approx(picture(64, 1)[1].mean(), abs=0.015)


@pytest.mark.parametrize("move", [0.0, 0.25, 0.5])
def test_one_texel_without_a_uv_map(move: float) -> None:
    """All of the surface lies on the border of two texels, of which Cycles shows the upper one."""
    item = square(lambda tree: through(tree, checks(tree)), uv_map=False)
    if move:
        uvs = np.full(8, move, np.float32)
        item.data.uv_layers.new(name="UVMap").uv.foreach_set("vector", uvs)
        bpy.context.view_layer.update()
    assert covered() == pytest.approx(picture(4, 1)[1].mean(), abs=1e-6)


def test_what_cannot_be_shown_names_the_material() -> None:
    square(OPACITIES["transparent and emission"])
    item = link(mesh("Floor", SQUARE, [(0, 1, 2, 3)], grey()), (0.0, 0.0, -1.0))
    notes = read().warnings
    assert [note for note in notes if note.startswith("Material 'Paint' is partly transparent")], notes
    assert item.data.materials[0].name not in " ".join(notes)


def test_values_of_zero_and_one_are_no_partial_opacity() -> None:
    """An attribute's own values count, not all that it could have."""
    item = square(OPACITIES["alpha of a color attribute"])
    assert read().warnings
    item.data.color_attributes["Paint"].data.foreach_set("color", np.tile([1.0, 1.0, 1.0, 0.0], 4))
    assert read().warnings == []


def facing(tree: Tree) -> Socket:
    backs = number(tree, "NewGeometry").node.outputs["Backfacing"]
    return over(tree, backs, paint(tree), clear(tree))


PICTURES: dict[str, Callable[[Tree], Socket]] = {
    "half of a cut-out": lambda t: over(t, 0.5, paint(t), through(t, checks(t))),
    "seven tenths": lambda t: over(t, 0.7, clear(t), paint(t)),
    "threshold on an attribute": OPACITIES["threshold on an attribute"],
    "backs are see-through": facing,
}


@pytest.mark.parametrize("name", PICTURES)
def test_pictures_are_those_of_cycles(name: str) -> None:
    """Two squares before a ground, one turned to the camera and one away from it."""
    item = square(PICTURES[name])
    item.location, item.rotation_euler.x = (1.1, 0.0, 1.2), 1.2
    other = link(bpy.data.objects.new("Other", item.data), (-1.1, 0.0, 1.2))
    other.rotation_euler.x = 1.2 + np.pi
    link(mesh("Ground", [(4 * x, 4 * y, z) for x, y, z in SQUARE], [(0, 1, 2, 3)], grey()))
    lamp("SUN", 2.0, angle=0.1).rotation_euler = (0.5, 0.3, 0.0)
    world().nodes["Background"].inputs[0].default_value = (0.4, 0.4, 0.5, 1.0)
    look_from((0.0, -5.0, 4.0), (0.0, 0.0, 0.8))
    settings = {"depth": 7, "size": (64, 64), "max_samples": 8, "gloss": "off", "cells": "everywhere", "color": False}
    assert_as_cycles(checked(cameras=("Eye",), **settings), psnr_db=25.0, ratio=0.03)
