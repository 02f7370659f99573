# SPDX-License-Identifier: GPL-3.0-or-later
"""Joined triangles show what their materials ask of each object: coordinates, random numbers, colours, back sides."""

from collections.abc import Callable

import bpy
import numpy as np
import pytest
from mathutils import Euler, Matrix

from patchnet.operators.cycles.bake import bake_luminance
from patchnet.operators.scene.read import read_scene
from patchnet.operators.scene.scene_mesh import SceneMesh
from patchnet.operators.settings.groups import LightSettings
from patchnet.patchnet_addon.lightmap.atlas import Atlas
from patchnet.patchnet_addon.lightmap.atlas_shade import atlas_shade
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.mesh import Fragments
from patchnet.tests.blender.light_scene import SQUARE
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot

pytestmark = pytest.mark.usefixtures("empty_scene")

REC709 = np.array([0.2126, 0.7152, 0.0722])


def glowing(color: Callable[[bpy.types.NodeTree], bpy.types.NodeSocket], in_group: bool = False) -> bpy.types.Material:
    """A material that emits what a node yields."""
    material = bpy.data.materials.new("Glow")
    if material.node_tree is None:
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    if in_group:
        group = bpy.data.node_groups.new("Inner", "ShaderNodeTree")
        group.interface.new_socket("Value", in_out="OUTPUT", socket_type="NodeSocketColor")
        group.links.new(color(group), group.nodes.new("NodeGroupOutput").inputs[0])
        user = tree.nodes.new("ShaderNodeGroup")
        user.node_tree = group
        socket = user.outputs[0]
    else:
        socket = color(tree)
    emission = tree.nodes.new("ShaderNodeEmission")
    tree.links.new(socket, emission.inputs["Color"])
    tree.links.new(emission.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    return material


def square(name: str, material: bpy.types.Material) -> bpy.types.Object:
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(SQUARE, [], [(0, 1, 2, 3)])
    mesh.materials.append(material)
    mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", np.array([0, 0, 1, 0, 1, 1, 0, 1], np.float32))
    item = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(item)
    return item


def baked(texel_world: float = 0.05) -> tuple[SceneMesh, Atlas]:
    bpy.context.view_layer.update()
    source = read_scene(bpy.context.evaluated_depsgraph_get())
    return source, drain(bake_luminance(bpy.context, source, texel_world, LightSettings(samples=16, color=False)))


def at_points(source: SceneMesh, atlas: Atlas) -> tuple[np.ndarray, np.ndarray]:
    """World points (N, 3) inside triangles and the luminance there."""
    shade = atlas_shade(atlas, source)
    points, values = [], []
    local = np.array([(0.3, 0.3), (0.2, 0.5), (0.5, 0.2), (0.4, 0.4)], np.float32)
    for batch in source.batches():
        for triangle in range(len(batch)):
            fragments = Fragments(np.zeros(4, np.uint64), np.full(4, triangle, np.int32), local, np.full(4, 1e-4))
            values.append(shade(batch, fragments)[0])
            corners = batch.corners_world[triangle]
            points.append(corners[0] + local @ (corners[1:] - corners[0]))
    return np.concatenate(points), np.concatenate(values)


@pytest.mark.parametrize("kind", ["Generated", "Object"])
@pytest.mark.parametrize("in_group", [False, True])
def test_coordinates_of_each_object(kind: str, in_group: bool) -> None:
    def coordinates(tree: bpy.types.NodeTree) -> bpy.types.NodeSocket:
        absolute = tree.nodes.new("ShaderNodeVectorMath")
        absolute.operation = "ABSOLUTE"
        tree.links.new(tree.nodes.new("ShaderNodeTexCoord").outputs[kind], absolute.inputs[0])
        return absolute.outputs[0]

    first = square("First", glowing(coordinates, in_group))
    first.matrix_world = Matrix.Translation((3, 1, -2)) @ Euler((0.4, 0.2, 1.0)).to_matrix().to_4x4()
    second = bpy.data.objects.new("Second", first.data)
    bpy.context.scene.collection.objects.link(second)
    second.matrix_world = Matrix.Translation((-5, 2, 4)) @ Matrix.Diagonal((-0.5, 2.0, 1.0, 1.0))
    bpy.context.view_layer.update()
    before = scene_snapshot()
    source, atlas = baked()
    assert_unchanged(before)
    assert atlas.warnings == ()
    points, values = at_points(source, atlas)
    for item, part in zip((first, second), np.split(np.arange(len(points)), 2), strict=True):
        inverse = np.array(item.matrix_world.inverted())
        local = points[part] @ inverse[:3, :3].T + inverse[:3, 3]
        expected = (local + 1) / 2 if kind == "Generated" else local
        expected[:, 2] = 0.5 if kind == "Generated" else 0.0  # a flat mesh lies in the middle of its texture space
        np.testing.assert_allclose(values[part], np.abs(expected) @ REC709, atol=0.02)


def own_bake(item: bpy.types.Object, side: int = 64) -> np.ndarray:
    """Luminance (side, side) as Cycles bakes the object itself, through its own UV map."""
    image = bpy.data.images.new("Own", side, side, float_buffer=True, is_data=True)
    tree = item.data.materials[0].node_tree
    target = tree.nodes.new("ShaderNodeTexImage")
    target.image = image
    tree.nodes.active = target
    bpy.context.scene.render.engine = "CYCLES"
    bpy.context.scene.cycles.samples = 64
    with bpy.context.temp_override(active_object=item, object=item, selected_objects=[item]):
        bpy.ops.object.bake(type="EMIT", margin=0)
    pixels = np.empty(side * side * 4, np.float32)
    image.pixels.foreach_get(pixels)
    return pixels.reshape(side, side, 4)[..., :3] @ REC709


def noise(tree: bpy.types.NodeTree) -> bpy.types.NodeSocket:
    node = tree.nodes.new("ShaderNodeTexNoise")
    node.inputs["Scale"].default_value = 2.0
    return node.outputs["Color"]


@pytest.mark.parametrize("output", ["Random", "Location", "Color", "Alpha", "Object Index", "Material Index", "noise"])
def test_object_info_is_what_cycles_says(output: str) -> None:
    def info(tree: bpy.types.NodeTree) -> bpy.types.NodeSocket:
        return tree.nodes.new("ShaderNodeObjectInfo").outputs[output]

    item = square("Plate.017", glowing(noise if output == "noise" else info))
    item.location, item.color, item.pass_index = (0.3, 0.7, 0.2), (0.1, 0.6, 0.9, 0.4), 3
    item.data.materials[0].pass_index = 7
    source, atlas = baked()
    points, values = at_points(source, atlas)
    expected = own_bake(item)
    texel = ((points[:, :2] - np.array(item.location)[:2] + 1) / 2 * 64).astype(int)
    np.testing.assert_allclose(values, expected[texel[:, 1], texel[:, 0]], rtol=0.03, atol=0.01)
    assert expected.max() > 0.01


def test_random_numbers_of_instances() -> None:
    item = square("Tile", glowing(lambda tree: tree.nodes.new("ShaderNodeObjectInfo").outputs["Random"]))
    group = bpy.data.collections.new("Tiles")
    bpy.context.scene.collection.objects.unlink(item)
    group.objects.link(item)
    for number in range(4):
        empty = bpy.data.objects.new(f"Empty {number}", None)
        bpy.context.scene.collection.objects.link(empty)
        empty.instance_type, empty.instance_collection = "COLLECTION", group
        empty.location.x = 4 * number
    source, atlas = baked(0.5)
    _, values = at_points(source, atlas)
    values = values.reshape(4, -1)
    assert (np.ptp(values, axis=1) < 1e-5).all() and len(np.unique(values[:, 0].round(4))) == 4
    assert ((values > 0) & (values < 1)).all()


def test_back_sides_know_it() -> None:
    """A material that glows on its back only: both sides count, so half of it."""
    square("Paper", glowing(lambda tree: tree.nodes.new("ShaderNodeNewGeometry").outputs["Backfacing"]))
    _, atlas = baked(0.5)
    assert atlas.texels[:, 0].max() == pytest.approx(1.0, rel=1e-3), "the dark front does not count"


def test_what_is_lost_is_named() -> None:
    square("Mirror", glowing(lambda tree: tree.nodes.new("ShaderNodeTexCoord").outputs["Reflection"]))
    _, atlas = baked(0.5)
    (warning,) = atlas.warnings
    assert "'Glow'" in warning and "'Texture Coordinate'" in warning


def test_vertex_colors_and_other_attributes() -> None:
    def attribute(name: str) -> Callable[[bpy.types.NodeTree], bpy.types.NodeSocket]:
        def color(tree: bpy.types.NodeTree) -> bpy.types.NodeSocket:
            node = tree.nodes.new("ShaderNodeAttribute")
            node.attribute_name = name
            return node.outputs["Color"]

        return color

    for index, (name, kind, key, domain, value) in enumerate(
        [
            ("Paint", "FLOAT_COLOR", "color", "CORNER", (0.2, 0.4, 0.6, 1.0)),
            ("Wet", "FLOAT", "value", "FACE", (0.35,)),
            ("Flow", "FLOAT_VECTOR", "vector", "POINT", (0.1, 0.9, 0.3)),
        ]
    ):
        item = square(name, glowing(attribute(name)))
        item.location.x = 5 * index
        layer = item.data.attributes.new(name, kind, domain)
        layer.data.foreach_set(key, np.array(value * len(layer.data), np.float32))
    source, atlas = baked(0.5)
    _, values = at_points(source, atlas)
    expected = [REC709 @ (0.2, 0.4, 0.6), 0.35, REC709 @ (0.1, 0.9, 0.3)]
    np.testing.assert_allclose(values.reshape(3, -1), np.repeat(np.array(expected)[:, None], 8, 1), rtol=1e-3)
