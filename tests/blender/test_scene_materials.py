# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials of hand-made node trees and of the glTF importer, as the engine reads them."""

import base64
import json
from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet.operators.scene.files import open_scene
from patchnet.operators.scene.images import ImageReader
from patchnet.operators.scene.materials import read_material
from patchnet.operators.scene.node_terms import TextureUse
from patchnet.patchnet_addon.surface.chroma import REC709
from patchnet.patchnet_addon.surface.mesh import Material
from patchnet.tests.blender.light_scene import picture as rendered
from patchnet.tests.blender.objects import SQUARE, mesh
from patchnet.tests.blender.objects import link as put
from patchnet.tests.blender.objects import read as read_surface
from patchnet.tests.blender.shaders import added, shader, shown, simple
from patchnet.tests.blender.shaders import image as any_image
from patchnet.tests.blender.shaders import material as bare

pytestmark = pytest.mark.usefixtures("empty_scene")


def principled(name: str = "Paint") -> tuple[bpy.types.Material, bpy.types.Node]:
    material = simple("BsdfPrincipled", name)
    return material, material.node_tree.nodes["Principled BSDF"]


def add(material: bpy.types.Material, kind: str, **inputs: object) -> bpy.types.Node:
    node = material.node_tree.nodes.new(kind)
    for name, value in inputs.items():
        node.inputs[name].default_value = value
    return node


def image(name: str, pixels: np.ndarray, *, float_buffer: bool = False, data: bool = False) -> bpy.types.Image:
    """As most files are: of bytes."""
    return any_image(name, pixels, float_buffer=float_buffer, data=data)


def texture(material: bpy.types.Material, picture: bpy.types.Image) -> bpy.types.Node:
    node = add(material, "ShaderNodeTexImage")
    node.image = picture
    return node


def read(material: bpy.types.Material) -> tuple[Material, str | None]:
    """The material and all that was simplified."""
    result, *notes, _gloss = read_material(material, ImageReader())
    return result, " ".join(note for note in notes if note) or None


def link(material: bpy.types.Material, start: bpy.types.NodeSocket, end: bpy.types.NodeSocket) -> None:
    material.node_tree.links.new(start, end)


PIXELS = np.random.default_rng(0).integers(0, 256, (4, 6, 4)) / 255.0


def decoded(values: np.ndarray) -> np.ndarray:
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize("kind", ["byte", "float", "data"])
def test_images_become_linear(kind: str) -> None:
    material, node = principled()
    picture = image("Picture", PIXELS, float_buffer=kind == "float", data=kind == "data")
    picture.alpha_mode = "CHANNEL_PACKED"
    link(material, texture(material, picture).outputs["Color"], node.inputs["Base Color"])
    result, warning = read(material)
    assert warning is None and result.base_texture is not None
    expected = decoded(PIXELS[..., :3]) if kind == "byte" else PIXELS[..., :3]
    np.testing.assert_allclose(result.base_texture.pixels, expected, atol=1e-5)
    assert result.base_texture.pixels.dtype == np.float32


@pytest.mark.parametrize("is_used", [False, True])
@pytest.mark.parametrize("mode", ["STRAIGHT", "PREMUL", "CHANNEL_PACKED", "NONE"])
@pytest.mark.parametrize("kind", ["byte", "float", "data"])
def test_alpha_of_images_counts_as_in_cycles(kind: str, mode: str, is_used: bool) -> None:
    """Cycles shows the colours of an image, times its alpha where that `is_used`; each texel has 4 x 4 pixels."""
    pixels = np.full((4, 4, 4), 0.5)
    pixels[..., 0], pixels[..., 3] = PIXELS[:, :4, 0], [0.0, 0.25, 0.75, 1.0]
    picture = image("Picture", pixels, float_buffer=kind == "float", data=kind == "data")
    picture.alpha_mode = mode
    glow, tree = bare("Glow")
    used = texture(glow, picture)
    used.interpolation = "Closest"
    emission = shader(tree, "Emission").node
    shown(tree, emission.outputs[0])
    link(glow, used.outputs["Color"], emission.inputs["Color"])
    if is_used:
        link(glow, used.outputs["Alpha"], emission.inputs["Strength"])
    item = put(mesh("Square", SQUARE, [(0, 1, 2, 3)], glow))
    item.data.uv_layers.new().uv.foreach_set("vector", [0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0])
    use, reader = TextureUse(picture, straight=is_used), ImageReader()
    found = reader.color(use) @ REC709 * (reader.channel(use, "A")[..., 0] if is_used else 1.0)
    expected = rendered(1, 1)[0].reshape(4, 4, 4, 4)[:, 1:3, :, 1:3].mean(axis=(1, 3))
    np.testing.assert_allclose(found, expected, atol=0.005)  # Cycles multiplies bytes


def test_image_times_factor_in_a_node_of_old_files() -> None:
    material, node = principled()
    mix = add(material, "ShaderNodeMixRGB")
    mix.blend_type = "MULTIPLY"
    mix.inputs[0].default_value, mix.inputs[2].default_value = 1.0, (0.5, 0.25, 1.0, 1.0)
    link(material, texture(material, image("Picture", PIXELS)).outputs["Color"], mix.inputs[1])
    link(material, mix.outputs["Color"], node.inputs["Base Color"])
    result, warning = read(material)
    assert warning is None and result.base_texture is not None
    assert result.base_color == pytest.approx((0.5, 0.25, 1.0))


@pytest.mark.parametrize(
    "operations, threshold, scale, offset",
    [
        ([("GREATER_THAN", 0.3)], 0.3, 1.0, 0.0),
        ([("ROUND", None)], 0.5, 1.0, 0.0),
        ([("MULTIPLY", 0.5), ("LESS_THAN", 0.25), ("1-", None)], 0.25, 0.5, 0.0),
        ([("1-", None)], None, -1.0, 1.0),
        ([("LESS_THAN", 0.4)], 0.6, -1.0, 1.0),
    ],
)
def test_alpha_through_math(operations: list, threshold: float | None, scale: float, offset: float) -> None:
    material, node = principled()
    socket = texture(material, image("Leaf", PIXELS)).outputs["Alpha"]
    for operation, value in operations:
        math = add(material, "ShaderNodeMath")
        math.operation = "SUBTRACT" if operation == "1-" else operation
        if operation == "1-":
            math.inputs[0].default_value = 1.0
            link(material, socket, math.inputs[1])
        else:
            link(material, socket, math.inputs[0])
            math.inputs[1].default_value = value or 0.0
        socket = math.outputs[0]
    link(material, socket, node.inputs["Alpha"])
    result, warning = read(material)
    assert warning is None and result.alpha_texture is not None
    assert result.alpha_threshold == (None if threshold is None else pytest.approx(threshold))
    np.testing.assert_allclose(
        result.alpha_texture.pixels[..., 0], np.clip(PIXELS[..., 3] * scale + offset, 0, 1), atol=1e-5
    )


def test_mix_with_transparent_groups_reroutes_and_muted_nodes() -> None:
    material, node = principled()
    tree = material.node_tree
    node.inputs["Base Color"].default_value = (0.2, 0.4, 0.6, 1)
    group = bpy.data.node_groups.new("Cut", "ShaderNodeTree")
    group.interface.new_socket("Alpha", in_out="INPUT", socket_type="NodeSocketFloat")
    group.interface.new_socket("Shader", in_out="INPUT", socket_type="NodeSocketShader")
    group.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    enter, leave = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    mix = group.nodes.new("ShaderNodeMixShader")
    group.links.new(enter.outputs[0], mix.inputs[0])
    group.links.new(group.nodes.new("ShaderNodeBsdfTransparent").outputs[0], mix.inputs[1])
    group.links.new(enter.outputs[1], mix.inputs[2])
    group.links.new(mix.outputs[0], leave.inputs[0])
    user = tree.nodes.new("ShaderNodeGroup")
    user.node_tree = group
    reroute = tree.nodes.new("NodeReroute")
    muted = tree.nodes.new("ShaderNodeMath")
    muted.mute = True
    picture = texture(material, image("Leaf", PIXELS))
    tree.links.new(picture.outputs["Alpha"], muted.inputs[0])
    tree.links.new(muted.outputs[0], reroute.inputs[0])
    tree.links.new(reroute.outputs[0], user.inputs[0])
    tree.links.new(node.outputs[0], user.inputs[1])
    tree.links.new(user.outputs[0], tree.get_output_node("CYCLES").inputs["Surface"])
    result, warning = read(material)
    assert warning is None
    assert result.base_color == pytest.approx((0.2, 0.4, 0.6))
    np.testing.assert_allclose(result.alpha_texture.pixels[..., 0], PIXELS[..., 3], atol=1e-5)


def test_diffuse_plus_emission_and_no_shader() -> None:
    material, _ = principled()
    tree = material.node_tree
    glow = shader(tree, "Emission", Color=(1, 1, 0, 1), Strength=2.0)
    shown(tree, added(tree, shader(tree, "BsdfDiffuse", Color=(0.3, 0.3, 0.3, 1)), glow))
    result, _ = read(material)
    assert result.base_color == pytest.approx((0.3, 0.3, 0.3))
    assert result.emission == pytest.approx((2.0, 2.0, 0.0))
    tree.nodes.clear()
    result, warning = read(material)
    assert (result.alpha, result.base_color) == (1.0, (0.0, 0.0, 0.0)), "as Cycles shows it"
    assert warning is not None and "'Paint' is black" in warning


def test_texture_mapping() -> None:
    material, node = principled()
    picture = texture(material, image("Picture", PIXELS))
    mapping = add(material, "ShaderNodeMapping", Location=(0.5, 0.25, 0), Rotation=(0, 0, np.pi / 2), Scale=(2, 3, 1))
    link(material, add(material, "ShaderNodeUVMap").outputs[0], mapping.inputs["Vector"])
    link(material, mapping.outputs[0], picture.inputs["Vector"])
    link(material, picture.outputs["Color"], node.inputs["Base Color"])
    result, warning = read(material)
    assert warning is None
    np.testing.assert_allclose(result.base_texture.transform, [[0, -3, 0.5], [2, 0, 0.25]], atol=1e-6)


@pytest.mark.parametrize("other", ["", "Second"])
def test_color_and_opacity_on_their_uv_maps(other: str) -> None:
    """A map without a name is taken for the one that is named; of two that are named, opacity's is the material's."""
    material, node = principled("Leaf")
    for output, name, uv_map in (("Color", "Base Color", "First"), ("Alpha", "Alpha", other)):
        picture = texture(material, image(output, PIXELS))
        link(material, picture.outputs[output], node.inputs[name])
        uvs = add(material, "ShaderNodeUVMap")
        uvs.uv_map = uv_map
        link(material, uvs.outputs[0], picture.inputs["Vector"])
    result, warning = read(material)
    assert (result.name, result.uv_map) == ("Leaf", other or "First") and result.alpha_texture is not None
    assert (result.base_texture is None) == bool(other) == (warning is not None)
    if other:
        assert "image 'Color' counts by its mean color" in warning
        mean = decoded(PIXELS[..., :3] * PIXELS[..., 3:]).mean(axis=(0, 1))
        assert result.base_color == pytest.approx(tuple(mean), abs=1e-3)


def test_what_is_not_understood_is_said_once() -> None:
    material, node = principled("Marble")
    noise = add(material, "ShaderNodeTexNoise")
    link(material, noise.outputs["Color"], node.inputs["Base Color"])
    link(material, noise.outputs["Fac" if "Fac" in noise.outputs else "Factor"], node.inputs["Alpha"])
    node.inputs["Emission Strength"].default_value = 1.0
    link(material, add(material, "ShaderNodeVertexColor").outputs["Color"], node.inputs["Emission Color"])
    result, note, color_note, _ = read_material(material, ImageReader())
    assert (result.base_color, result.alpha) == ((0.8, 0.8, 0.8), 1.0)
    assert note is not None and color_note is not None
    assert "opacity" in note and "base color" in color_note and "vertex colors" in color_note


@pytest.mark.parametrize(("kind", "said"), [("TILED", "which is tiled"), ("SEQUENCE", "whose frames are not read")])
def test_opacity_by_many_pictures_is_said(kind: str, said: str) -> None:
    material, node = principled("Leaf")
    picture = image("Leaf", PIXELS)
    picture.source = kind
    link(material, texture(material, picture).outputs["Alpha"], node.inputs["Alpha"])
    result, note, *_ = read_material(material, ImageReader())
    assert result.alpha == 1.0 and f"its opacity depends on image 'Leaf', {said}" in str(note)


def test_missing_images_are_said(tmp_path: Path) -> None:
    lost = image("Gone", PIXELS)
    lost.filepath_raw, lost.file_format = str(tmp_path / "gone.png"), "PNG"
    lost.save()
    lost.source = "FILE"
    (tmp_path / "gone.png").unlink()
    lost.reload()
    for picture, words in ((lost, "image 'Gone' has no pixels"), (None, "node 'Image Texture' has no pixels")):
        material, node = principled("Lost")
        texture_node = add(material, "ShaderNodeTexImage")
        texture_node.image = picture
        link(material, texture_node.outputs["Color"], node.inputs["Base Color"])
        link(material, texture_node.outputs["Alpha"], node.inputs["Alpha"])
        result, warning = read(material)
        assert result.base_texture is None and (result.base_color, result.alpha) == ((1.0, 0.0, 1.0), 1.0), "as Cycles"
        assert warning is not None and words in warning


def write_gltf(path: Path, materials: list[dict], pixels: np.ndarray) -> None:
    """One triangle a material, with texture coordinates, and one texture."""
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    uvs = np.array([[0, 1], [1, 1], [0, 0]], np.float32)  # glTF counts from the top
    data = positions.tobytes() + uvs.tobytes()
    picture = image("pixels", pixels[::-1] / 255.0)  # Blender counts from the bottom
    picture.filepath_raw, picture.file_format = str(path.with_name("pixels.png")), "PNG"
    picture.save()
    content = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    document = {
        "asset": {"version": "2.0"}, "scene": 0,
        "scenes": [{"nodes": list(range(len(materials)))}],
        "nodes": [{"mesh": index, "translation": [2 * index, 0, 0]} for index in range(len(materials))],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": index}]}
                   for index in range(len(materials))],
        "materials": materials, "textures": [{"source": 0}], "images": [{"uri": "pixels.png"}],
        "buffers": [{"byteLength": len(data), "uri": content}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 24}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
            {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2"},
        ],
    }  # fmt: skip
    path.write_text(json.dumps(document))


def test_gltf_importers_materials(tmp_path: Path) -> None:
    pixels = np.random.default_rng(1).integers(0, 256, (3, 5, 4))
    textured = {"index": 0}
    materials = [
        {"name": "Plain", "pbrMetallicRoughness": {"baseColorFactor": [0.1, 0.2, 0.3, 0.5]}, "alphaMode": "BLEND"},
        {"name": "Opaque", "pbrMetallicRoughness": {"baseColorTexture": textured}},
        {"name": "Tinted",
         "pbrMetallicRoughness": {"baseColorTexture": textured, "baseColorFactor": [0.5, 1, 0.25, 1]}},
        {"name": "Mask", "alphaMode": "MASK", "alphaCutoff": 0.3,
         "pbrMetallicRoughness": {"baseColorTexture": textured}},
        {"name": "Blend", "alphaMode": "BLEND",
         "pbrMetallicRoughness": {"baseColorTexture": textured, "baseColorFactor": [1, 1, 1, 0.5]}},
        {"name": "Half mask", "alphaMode": "MASK", "alphaCutoff": 0.25,
         "pbrMetallicRoughness": {"baseColorTexture": textured, "baseColorFactor": [1, 1, 1, 0.5]}},
        {"name": "Lamp", "emissiveFactor": [1, 0.5, 0], "pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1]}},
    ]  # fmt: skip
    write_gltf(tmp_path / "scene.gltf", materials, pixels)
    open_scene(tmp_path / "scene.gltf")
    source = read_surface()
    (warning,) = source.warnings
    assert warning.startswith("Materials 'Plain', 'Blend' are partly transparent") and source.color_warnings == ()
    found = {material.name: material for material in source.materials}
    color, alpha = decoded(pixels[::-1, :, :3] / 255.0), pixels[::-1, :, 3] / 255.0
    assert found["Plain"].base_color == pytest.approx((0.1, 0.2, 0.3)) and found["Plain"].alpha == 0.5
    for name in ("Opaque", "Tinted", "Mask", "Blend", "Half mask"):
        np.testing.assert_allclose(found[name].base_texture.pixels, color, atol=1e-5)
    assert found["Opaque"].alpha_texture is None and found["Opaque"].alpha == 1.0
    assert found["Tinted"].base_color == pytest.approx((0.5, 1.0, 0.25))
    np.testing.assert_allclose(found["Mask"].alpha_texture.pixels[..., 0], alpha, atol=1e-5)
    assert found["Mask"].alpha_threshold == pytest.approx(0.3)
    assert found["Blend"].alpha_threshold is None
    kept = np.where(alpha * 0.5 >= 0.5, 0.5, 0.0)
    np.testing.assert_allclose(found["Blend"].alpha_texture.pixels[..., 0], kept, atol=1e-5)
    half = found["Half mask"]
    cut = half.alpha_texture.pixels[..., 0] * half.alpha >= half.alpha_threshold
    np.testing.assert_array_equal(cut, alpha * 0.5 >= 0.25)
    assert found["Lamp"].emission == pytest.approx((1.0, 0.5, 0.0))
    batch = next(source.batches())
    assert batch.uvs.min() == 0.0 and batch.uvs.max() == 1.0


@pytest.mark.parametrize(("method", "told"), [("BUMP", False), ("DISPLACEMENT", True), ("BOTH", True)])
def test_displacement_that_moves_the_surface_is_told(method: str, told: bool) -> None:
    material, _node = principled("Cobbles")
    tree = material.node_tree
    material.displacement_method = method
    assert read(material)[1] is None
    node = tree.nodes.new("ShaderNodeDisplacement")
    tree.links.new(node.outputs[0], tree.get_output_node("CYCLES").inputs["Displacement"])
    warning = read(material)[1]
    assert (warning is not None and "'Cobbles'" in warning and "Displace modifier" in warning) == told
