# SPDX-License-Identifier: GPL-3.0-or-later
"""Joined triangles keep coordinates, random numbers, colours and attributes of each object."""

import bpy
import numpy as np
import pytest
from mathutils import Euler, Matrix

from patchnet.tests.blender.job_scene import pixels_of
from patchnet.tests.blender.light_scene import (
    BakedSurfels,
    assert_agrees,
    assert_mean_of_views,
    bake,
    bake_surfels,
    compare,
)
from patchnet.tests.blender.objects import SQUARE, collection_instance, geometry_nodes, link, mesh, moved_to, read, slab
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot
from patchnet.tests.blender.shaders import Maker, glowing, read_by, simple, world

pytestmark = pytest.mark.usefixtures("empty_scene")

REC709 = np.array([0.2126, 0.7152, 0.0722])


def in_group(color: Maker) -> Maker:
    """What nodes in a group yield."""
    group = bpy.data.node_groups.new("Inner", "ShaderNodeTree")
    group.interface.new_socket("Value", in_out="OUTPUT", socket_type="NodeSocketColor")
    group.links.new(color(group), group.nodes.new("NodeGroupOutput").inputs[0])
    return read_by("Group", 0, node_tree=group)


def square(name: str, paint: bpy.types.Material) -> bpy.types.Object:
    item = link(mesh(name, SQUARE, [(0, 1, 2, 3)], paint))
    item.data.uv_layers.new(name="UVMap").uv.foreach_set("vector", [0, 0, 1, 0, 1, 1, 0, 1])
    return item


def baked(extent: float, voxel: float = 0.05) -> BakedSurfels:
    """Surfels of a surface of this extent in voxels of about that side."""
    found = bake_surfels(16, depth=int(np.ceil(np.log2(extent / voxel))))
    inside = np.minimum(
        np.minimum(found.surfels["one"], found.surfels["two"]), 1 - found.surfels["one"] - found.surfels["two"]
    )
    return found.only(inside > 0.05)  # off the edges, where colours change


def absolute(tree: bpy.types.NodeTree, value: bpy.types.NodeSocket, scale: float = 1.0) -> bpy.types.NodeSocket:
    """Absolute values of a vector, times a number."""
    for operation in ("SCALE", "ABSOLUTE"):
        math = tree.nodes.new("ShaderNodeVectorMath")
        math.operation = operation
        math.inputs[3].default_value = scale
        tree.links.new(value, math.inputs[0])
        value = math.outputs[0]
    return value


@pytest.mark.parametrize(("kind", "grouped"), [("Generated", False), ("Object", True)])
def test_coordinates_of_each_object(kind: str, grouped: bool) -> None:
    def coordinates(tree: bpy.types.NodeTree) -> bpy.types.NodeSocket:
        return absolute(tree, read_by("TexCoord", kind)(tree))

    first = square("First", glowing(in_group(coordinates) if grouped else coordinates))
    first.matrix_world = Matrix.Translation((3, 1, -2)) @ Euler((0.4, 0.2, 1.0)).to_matrix().to_4x4()
    second = bpy.data.objects.new("Second", first.data)
    bpy.context.scene.collection.objects.link(second)
    second.matrix_world = Matrix.Translation((-5, 2, 4)) @ Matrix.Diagonal((-0.5, 2.0, 1.0, 1.0))
    bpy.context.view_layer.update()
    before = scene_snapshot()
    found = baked(12.0)
    assert_unchanged(before)
    assert found.warnings == ()
    for item in (first, second):
        own = found.only(found.names == item.name)
        inverse = np.array(item.matrix_world.inverted())
        local = own.place @ inverse[:3, :3].T + inverse[:3, 3]
        expected = (local + 1) / 2 if kind == "Generated" else local
        expected[:, 2] = 0.5 if kind == "Generated" else 0.0  # a flat mesh lies in the middle of its texture space
        np.testing.assert_allclose(own.luminance, np.abs(expected) @ REC709, atol=0.02)


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
    return pixels_of(image)[..., :3] @ REC709


def between_texels(image: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Values at places (N, 3) of the square, linear between the texels of its image."""
    at = (places[:, :2] + 1.0) / 2.0 * len(image) - 0.5
    low = np.clip(np.floor(at).astype(int), 0, len(image) - 2)
    (x, y), (i, j) = (at - low).T, low.T
    rows = [(1.0 - x) * image[j + up, i] + x * image[j + up, i + 1] for up in (0, 1)]
    return (1.0 - y) * rows[0] + y * rows[1]


def noise(tree: bpy.types.NodeTree) -> bpy.types.NodeSocket:
    node = tree.nodes.new("ShaderNodeTexNoise")
    node.inputs["Scale"].default_value = 2.0
    return node.outputs["Color"]


@pytest.mark.parametrize("output", ["Random", "Location", "Color", "Alpha", "Object Index", "Material Index", "noise"])
def test_object_info_is_what_cycles_says(output: str) -> None:
    item = square("Plate.017", glowing(noise if output == "noise" else read_by("ObjectInfo", output)))
    item.location, item.color, item.pass_index = (0.3, 0.7, 0.2), (0.1, 0.6, 0.9, 0.4), 3
    item.data.materials[0].pass_index = 7
    assert_as_cycles([item], 0.03)


def test_back_sides_know_it() -> None:
    """A material that glows on its back only."""
    square("Paper", glowing(read_by("NewGeometry", "Backfacing")))
    found = bake(max_samples=4).fragments
    assert not found.sides[:, 0].any() and found.sides[:, 1] == pytest.approx(1.0, rel=1e-3)
    assert found.luminance == pytest.approx(1.0, rel=1e-3), "the dark front does not count"


ATTRIBUTE_TYPES = {  # key of the values and their width
    "FLOAT": ("value", 1), "INT": ("value", 1), "INT8": ("value", 1), "BOOLEAN": ("value", 1), "FLOAT2": ("vector", 2),
    "FLOAT_VECTOR": ("vector", 3), "FLOAT_COLOR": ("color", 4), "BYTE_COLOR": ("color", 4), "QUATERNION": ("value", 4),
    "FLOAT4": ("vector", 4),
}  # fmt: skip


def painted(name: str, kind: str, domain: str, seed: int = 0) -> bpy.types.Object:
    """A square of 2 x 2 faces with an attribute of random values."""
    item = square(name, bpy.data.materials.new("To be replaced"))
    data = item.data
    data.clear_geometry()
    places = np.linspace(-1.0, 1.0, 3)
    data.from_pydata([(x, y, 0.0) for y in places for x in places], [],
                     [(k, k + 1, k + 4, k + 3) for k in (0, 1, 3, 4)])  # fmt: skip
    corners = np.array([vertex.co[:2] for vertex in data.vertices])[[loop.vertex_index for loop in data.loops]]
    data.uv_layers.new(name="UVMap").uv.foreach_set("vector", ((corners + 1) / 2).astype(np.float32).ravel())
    layer = data.attributes.new(name, kind, domain)
    key, width = ATTRIBUTE_TYPES[kind]
    values = np.random.default_rng(seed).uniform(0.1, 1.0, (len(layer.data), width)).astype(np.float32)
    if kind in ("INT", "INT8", "BOOLEAN"):
        values = (values * 3).astype({"INT": np.int32, "INT8": np.int8}.get(kind, np.int32))
        values = values > 1 if kind == "BOOLEAN" else values
    layer.data.foreach_set(key, values.ravel())
    return item


def assert_as_cycles(items: list[bpy.types.Object], tolerance: float = 0.02) -> None:
    """Baked together, objects show what Cycles bakes of each alone."""
    bpy.context.view_layer.update()
    found = baked(2.0 + 3.0 * (len(items) - 1))
    for item in items:
        own = found.only((found.names == item.name) & (found.surfels["side"] == 0))
        expected = between_texels(own_bake(item), own.place - np.array(item.matrix_world.translation))
        atol = tolerance * max(expected.max(), 0.1)
        np.testing.assert_allclose(own.luminance, expected, rtol=tolerance, atol=atol)
        assert len(expected) > 100 and expected.max() > 0.01


@pytest.mark.parametrize(
    ("kind", "domain"),
    [(kind, "POINT") for kind in ATTRIBUTE_TYPES] + [("FLOAT_COLOR", domain) for domain in ("EDGE", "FACE", "CORNER")],
)
def test_attributes_of_all_types_on_all_domains(kind: str, domain: str) -> None:
    if kind not in bpy.types.Attribute.bl_rna.properties["data_type"].enum_items:
        pytest.skip(f"this Blender has no attributes of type {kind}")
    item = painted("Mask", kind, domain)
    item.data.materials[0] = glowing(read_by("Attribute", attribute_name="Mask"))
    assert_as_cycles([item])


def test_attributes_of_one_name_and_two_types() -> None:
    """A number on one mesh and a colour on the other, read by one material."""
    items = [painted("Mask", kind, "POINT", seed) for seed, kind in enumerate(("FLOAT", "FLOAT_COLOR"))]
    items[1].location.x = 3.0
    paint = glowing(read_by("Attribute", attribute_name="Mask"))
    for item in items:
        item.data.materials[0] = paint
    assert_as_cycles(items)


@pytest.mark.parametrize("kind", ["BYTE_COLOR", "FLOAT_COLOR"])
def test_color_attribute_without_a_name_is_the_default_one(kind: str) -> None:
    """As Blender's glTF importer makes it. The default colour attribute is not the active one, and its name differs."""
    items = [painted(name, kind, "CORNER", seed) for seed, name in enumerate(("Color", "Paint"))]
    items[1].location.x = 3.0
    paint = glowing(read_by("VertexColor"))
    for item in items:
        colors = item.data.color_attributes
        other = colors.new("Other", kind, "POINT")
        other.data.foreach_set("color", np.full(4 * len(other.data), 0.9, np.float32))
        colors.active_color = other
        colors.render_color_index = 0
        item.data.materials[0] = paint
    assert_as_cycles(items)


def test_more_uv_maps_than_a_mesh_takes_by_its_own_operator() -> None:
    """Twelve objects whose materials read twelve maps, one of them as a tangent.

    That one is even over its faces: a surfel has the tangent of its triangle, while Cycles smooths it between them.
    """
    items = []
    for number in range(12):
        item = square(f"Plate {number}", bpy.data.materials.new("To be replaced"))
        layer = item.data.uv_layers.new(name=f"map {number}")
        corners = [0.2, 0.9, 0.4, 0.1, 0.8, 0.3, 0.9, 0.7] if number < 11 else [0.2, 0.4, 0.8, 0.1, 1.1, 0.7, 0.5, 1.0]
        layer.uv.foreach_set("vector", np.array(corners, np.float32))
        node = read_by("UVMap", "UV", uv_map=layer.name)
        if number == 11:
            node = read_by("Tangent", "Tangent", direction_type="UV_MAP", uv_map=layer.name)
        item.data.materials[0] = glowing(node)
        item.location.x = 3.0 * number
        items.append(item)
    assert_as_cycles(items)


OWNERS = {
    "OBJECT": {"Plate": {"paint": (0.2, 0.7, 0.4)}},
    "INSTANCER": {"Plate": {"paint": (0.9, 0.9, 0.9)}, "Empty": {"paint": (0.1, 0.5, 0.3)}},
}


@pytest.mark.parametrize("kind", OWNERS)
def test_properties_of_objects_and_of_what_instances_them(kind: str) -> None:
    """Against Cycles' render of instances, whose own bake Blender does not offer."""
    item = slab("Plate", glowing(read_by("Attribute", attribute_name="paint", attribute_type=kind)))
    collection_instance(moved_to(bpy.data.collections.new("Plates"), item), "Empty")
    for name, values in OWNERS[kind].items():
        for key, value in values.items():
            bpy.data.objects[name][key] = value
    assert_agrees(compare(16, ["Empty"]))


def test_attributes_of_instances() -> None:
    """Geometry nodes store a colour for each instance."""
    tint = read_by("Attribute", attribute_name="tint", attribute_type="INSTANCER")
    item = slab("Plate", glowing(tint), (-0.5, -0.5), (0.5, 0.5))
    item.hide_render = True
    host = link(mesh("Host", [(x, y, 0.0) for x in (-0.5, 0.5) for y in (-0.5, 0.5)], []))
    tree, given, made = geometry_nodes(host)
    place, store = tree.nodes.new("GeometryNodeInstanceOnPoints"), tree.nodes.new("GeometryNodeStoreNamedAttribute")
    for start, end in ((given, place.inputs[0]), (place.outputs[0], store.inputs[0]), (store.outputs[0], made)):
        tree.links.new(start, end)
    plate, random = tree.nodes.new("GeometryNodeObjectInfo"), tree.nodes.new("FunctionNodeRandomValue")
    plate.inputs["Object"].default_value, plate.inputs["As Instance"].default_value = item, True
    tree.links.new(plate.outputs["Geometry"], place.inputs["Instance"])
    random.data_type, store.data_type, store.domain = "FLOAT_VECTOR", "FLOAT_COLOR", "INSTANCE"
    store.inputs["Name"].default_value = "tint"
    tree.links.new(random.outputs[0], next(s for s in store.inputs if s.name == "Value" and s.enabled))
    found = compare(16, ["Host"])
    assert_agrees(found, contrast=0.1)
    assert found.warnings == ()


INSTANCED = {
    **{output: ("ParticleInfo", output, {}) for output in ("Index", "Random", "Age", "Size", "Location")},
    "Generated": ("TexCoord", "Generated", {"from_instancer": True}),
}


@pytest.mark.parametrize("case", INSTANCED)
def test_particles_and_coordinates_of_what_instances(case: str) -> None:
    def socket(tree: bpy.types.NodeTree) -> bpy.types.NodeSocket:
        kind, output, settings = INSTANCED[case]
        return absolute(tree, read_by(kind, output, **settings)(tree), 0.1)

    item = slab("Plate", glowing(socket), (-0.3, -0.3), (0.3, 0.3))
    item.hide_render = True
    host = link(mesh("Host", [(0.6 * x, 0.6 * y, 0.0) for x, y, _ in SQUARE], [(0, 1, 2, 3)]))
    host.show_instancer_for_render = False
    host.data.uv_layers.new(name="Map").uv.foreach_set("vector", [0.1, 0.3, 0.9, 0.2, 0.8, 0.7, 0.2, 0.9])
    system = host.modifiers.new("Particles", "PARTICLE_SYSTEM").particle_system.settings
    system.count, system.emit_from, system.distribution, system.userjit = 4, "FACE", "GRID", 1
    system.grid_resolution = 2
    system.frame_start, system.frame_end, system.physics_type = 1, 1, "NO"
    system.render_type, system.instance_object, system.particle_size = "OBJECT", item, 1.0
    bpy.context.scene.frame_set(5)
    assert_agrees(compare(16, ["Host"]))


def test_attribute_that_nothing_has_is_named() -> None:
    square("Plate", glowing(read_by("Attribute", attribute_name="paint", attribute_type="OBJECT")))
    (warning,) = read().warnings
    assert "'paint'" in warning


def test_what_depends_on_the_angle_is_the_mean_of_all_views() -> None:
    found = assert_mean_of_views(glowing(read_by("LayerWeight", "Facing")), 16, rel=0.1)
    assert np.ptp(found.luminance) < 0.01 * found.luminance.mean() and len(found.warnings) == 1


@pytest.mark.parametrize(
    ("kind", "inputs"),
    [
        ("BsdfDiffuse", {"Color": (0.2, 0.2, 0.2, 1.0), "Roughness": 1.0}),
        ("BsdfPrincipled", {"Base Color": (0.8, 0.6, 0.4, 1.0), "Diffuse Roughness": 0.6, "Specular IOR Level": 0.0}),
        ("BsdfPrincipled", {"Sheen Weight": 0.8, "Sheen Roughness": 0.7, "Specular IOR Level": 0.0}),
        ("BsdfSheen", {"Roughness": 0.6}),
    ],
)
def test_cloth_is_the_mean_of_all_views(kind: str, inputs: dict) -> None:
    """Under an even sky."""
    world().nodes["Background"].inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    paint = simple(kind, "Cloth", **inputs)
    (warning,) = assert_mean_of_views(paint, 64, rel=0.05).warnings
    assert f"'{paint.node_tree.nodes[-1].name}' of material 'Cloth'" in warning
