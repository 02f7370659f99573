# SPDX-License-Identifier: GPL-3.0-or-later
"""Odd and damaged data of other people's files: as in Cycles, or left out with a sentence that names the object."""

import logging
from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
import pytest

from patchnet.operators.cycles.bake import bake_materials
from patchnet.operators.scene import coincident, instance_values, light_links, local_mesh
from patchnet.operators.scene import read as reading_of_scenes
from patchnet.operators.scene.fingerprint import lights_hash
from patchnet.operators.state import block_hashes, digest
from patchnet.patchnet_addon.runtime.errors import EmptySelectionError, GeometryError
from patchnet.tests.blender.light_scene import bake, light_of_regions, lit, picture, regions
from patchnet.tests.blender.objects import SQUARE, collection_instance, cuboid, lamp, link, mesh, read
from patchnet.tests.blender.shaders import glowing, image, read_by, simple

pytestmark = pytest.mark.usefixtures("empty_scene")

TILE = [(x / 2 + 0.5, y / 2 + 0.5, z) for x, y, z in SQUARE]
CUBE = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
SMALL = {"depth": 4, "max_samples": 2, "cells": "everywhere"}


def reading(kind: str, name: str, node: str = "Attribute") -> bpy.types.Material:
    """A material that emits what a node reads by a name."""
    return glowing(read_by(node, 0, **{kind: name}), f"Reading {name}")


def tile(name: str, paint: bpy.types.Material, x: float, y: float) -> bpy.types.Object:
    item = link(mesh(name, TILE, [(0, 1, 2, 3)], paint), (x, y, 0.0))
    item.data.uv_layers.new(name="UVMap").uv.foreach_set("vector", [0, 0, 1, 0, 1, 1, 0, 1])
    return item


def assert_as_cycles() -> None:
    """What glows at z = 0 has the baked light that Cycles renders."""
    found = light_of_regions(bake(depth=6, max_samples=4).fragments)
    expected = regions(picture(16, 1))
    np.testing.assert_allclose(found, expected, atol=0.05)
    assert expected.any()


NAMES = [
    "id", "position", "custom_normal", "material_index", "sharp_face", "crease_edge", ".hidden", "a.b", "x" * 60,
    "PatchNet Texels", "PatchNet Charts", "Color", "color", "vertex_color", "N", "generated",
]  # fmt: skip


@pytest.mark.parametrize("node", ["Attribute", "VertexColor"])
def test_attributes_of_any_name_are_those_of_cycles(node: str) -> None:
    """Tiles, whose materials read an attribute that Blender, Cycles or PatchNet has a use for."""
    for number, name in enumerate(NAMES):
        paint = reading("attribute_name" if node == "Attribute" else "layer_name", name, node)
        item = tile(name, paint, number % 4 / 2 - 1.0, number // 4 / 2 - 1.0)
        item.scale = (0.5, 0.5, 1.0)
        colors = item.data.attributes.new(name, "FLOAT_COLOR", "CORNER")
        if colors is not None and colors.name == name and (node == "Attribute" or number < 14):
            colors.data.foreach_set("color", [0.2, 0.4, 0.6, 1.0] * 4)
        elif node == "VertexColor":  # Cycles reads numbers there as if they were colours, and beyond their end
            bpy.data.objects.remove(item)
    assert_as_cycles()


def test_uvs_that_are_no_numbers_are_those_of_cycles() -> None:
    paint = glowing(read_by("TexImage", image=image("Light", np.full((4, 4, 4), 0.7), data=True)))
    for number, value in enumerate((np.nan, np.inf, 1e30, 0.3)):
        item = tile(f"{value}", paint, number % 2 - 1.0, number // 2 - 1.0)
        item.data.uv_layers[0].uv.foreach_set("vector", np.full(8, value, np.float32))
    assert_as_cycles()


def test_flat_faces_with_normals_of_their_own_stay_flat() -> None:
    """Normals of vertices, which are none of Cycles' on faces without smooth shading."""
    paint = glowing(read_by("NewGeometry", "Normal"))
    for number, smooth in enumerate((True, False)):
        item = tile(f"{smooth}", paint, number - 1.0, 0.0)
        item.data.polygons[0].use_smooth = smooth
        normals = item.data.attributes.new("custom_normal", "FLOAT_VECTOR", "POINT")
        normals.data.foreach_set("vector", [0.8, 0.0, 0.6] * 4)
    assert_as_cycles()


def empties() -> None:
    """Data of each type in which nothing is."""
    for name, data in (
        ("Hair", bpy.data.hair_curves.new("Hair")),
        ("Points", bpy.data.pointclouds.new("Points")),
        ("Curve", bpy.data.curves.new("Curve", "CURVE")),
        ("Surface", bpy.data.curves.new("Surface", "SURFACE")),
        ("Text", bpy.data.curves.new("Text", "FONT")),
        ("Ball", bpy.data.metaballs.new("Ball")),
        ("Lattice", bpy.data.lattices.new("Lattice")),
        ("Bones", bpy.data.armatures.new("Bones")),
        ("Smoke", bpy.data.volumes.new("Smoke")),
        ("Mesh", bpy.data.meshes.new("Mesh")),
    ):
        link(bpy.data.objects.new(name, data))
    bpy.data.objects["Text"].data.body = ""
    link(mesh("Edges", SQUARE, []))
    collection_instance(bpy.data.collections.new("Nothing"))
    bpy.data.objects["Mesh"].modifiers.new("Nodes", "NODES")
    link(mesh("Slots", SQUARE, [], simple())).modifiers.new("Array", "ARRAY")


def test_empty_data_has_no_voxels() -> None:
    empties()
    cuboid("Box", *CUBE)
    lamp("SUN", 2.0)
    made = lit(**SMALL)
    assert made.source.object_names == ["Box"] and made.octree.luminance.any()
    assert not any("unexpected" in text for text in made.warnings)
    bpy.data.objects["Box"].hide_render = True
    with pytest.raises(EmptySelectionError):
        read()


def test_faces_without_vertices_are_refused() -> None:
    """Blender crashes as it renders them."""
    data = bpy.data.meshes.new("Odd")
    data.loops.add(3)
    data.polygons.add(1)
    data.polygons[0].loop_start = 0
    link(bpy.data.objects.new("Odd", data))
    with pytest.raises(GeometryError, match=r"object 'Odd' has faces without vertices.*meshes\['Odd'\]\.validate"):
        read()


def test_what_is_not_finite_is_left_out() -> None:
    paint = simple("Emission", Strength=0.5)
    for number, name in enumerate(("Whole", "Gone", "Turned", "Half")):
        tile(name, paint, number % 2 - 1.0, number // 2 - 1.0)
    bpy.data.objects["Gone"].data.vertices.foreach_set("co", np.full(12, np.inf, np.float32))
    bpy.data.objects["Turned"].scale = (np.nan, 1.0, 1.0)
    corner = np.array(TILE, np.float32)
    corner[2] = np.nan
    half = bpy.data.objects["Half"].data
    half.clear_geometry()
    half.from_pydata(TILE * 2, [], [(0, 1, 2, 3), (4, 5, 6, 7)])
    half.vertices.foreach_set("co", np.concatenate([np.array(TILE, np.float32), corner]).ravel())
    hair = bpy.data.hair_curves.new("Hair")
    link(bpy.data.objects.new("Hair", hair))
    hair.add_curves([2])
    hair.position_data.foreach_set("vector", np.full(6, np.nan, np.float32))
    source = read()
    assert sorted(source.object_names) == ["Half", "Whole"]
    assert any("Hair and points with coordinates" in text and "'Hair'" in text for text in source.warnings)
    assert any("vertices that are not finite" in text and "'Gone', 'Half'" in text for text in source.warnings)
    assert any("positions or scales that are not" in text and "'Turned'" in text for text in source.warnings)
    assert_as_cycles()


def test_faces_on_each_other_are_named() -> None:
    """Copies at one place, overlapping planes, doubled faces; not what touches, nor a box on the ground."""
    for name, x in (("One", 4.0), ("Other", 4.0), ("Neighbour", 5.0)):
        cuboid(name, *CUBE).location.x = x
    for name, x, z in (("Ground", 0.0, -0.001), ("Rug", 0.0, 0.0), ("Mat", 1.5, 0.0), ("Tile", -2.0, 0.0)):
        link(mesh(name, SQUARE, [(0, 1, 2, 3)]), (x, 0.0, z))
    link(mesh("Twice", SQUARE * 2, [(0, 1, 2, 3), (4, 5, 6, 7)]), (0.0, 9.0, 0.0))
    link(mesh("Both sides", SQUARE * 2, [(0, 1, 2, 3), (7, 6, 5, 4)]), (0.0, 6.0, 0.0))
    (said,) = [text for text in read().warnings if "exactly on others" in text]
    assert "Faces of 'Mat', 'One', 'Other', 'Rug', 'Twice' lie" in said


@pytest.mark.parametrize("side", [2, 3, 8])
def test_faces_of_a_grid_are_distinct(side: int) -> None:
    """Hashes of few and round coordinates differ, too."""
    places = [(x / side, y / side, 0.0) for y in range(side + 1) for x in range(side + 1)]
    cells = [(side + 1) * y + x for y in range(side) for x in range(side)]
    link(mesh("Grid", places, [(cell, cell + 1, cell + side + 2, cell + side + 1) for cell in cells]))
    assert read().warnings == []
    corners = np.random.default_rng(2).permuted(np.tile(np.arange(27), (20000, 1)), axis=1)[:, :3]
    corners = np.unique(np.take_along_axis(corners, (corners.argmin(1)[:, None] + np.arange(3)) % 3, 1), axis=0)
    keys = coincident._keys((np.stack(np.unravel_index(corners, (3, 3, 3)), -1) - 1.0).astype(np.float32))
    assert len(np.unique(keys)) == len(keys)


def _names(values: tuple[Any, ...]) -> list[str]:
    """Names of data-blocks that arguments are, or belong to, or are nodes of."""
    owners = [
        owner for value in values for owner in (value, getattr(value, "object", None), getattr(value, "mesh", None))
    ]
    owners += [getattr(value, "id_data", None) for value in values]
    trees = [value for value in values if isinstance(value, bpy.types.NodeTree)]
    owners += [paint for paint in bpy.data.materials if paint.node_tree in trees]
    return [owner.name for owner in owners if isinstance(owner, bpy.types.ID)]


FAULTS = {
    "layers of materials": (reading_of_scenes, "layer_names", "Object 'Bad' is left out"),
    "mesh": (reading_of_scenes, "read_local_mesh", "Object 'Bad' is left out"),
    "hash of modifiers": (reading_of_scenes, "origin_of_corners", "Object 'Bad' is left out"),
    "attribute": (local_mesh, "_layer", "Object 'Bad' is left out"),
    "UVs": (local_mesh, "_uvs", "Object 'Bad' is left out"),
    "normals": (local_mesh, "_normals", "Object 'Bad' is left out"),
    "value of an instance": (instance_values, "_of_object", "Object 'Bad' is left out"),
    "light links": (light_links.LightLinks, "number", "Object 'Bad' is left out"),
    "material": (reading_of_scenes, "read_material", "Material 'Bad' is read as plain gray"),
    "material to bake": (bake_materials, "needs_redirect", "Material 'Bad' is baked without values of objects"),
    "hash of a mesh": (block_hashes, "_mesh", "Object 'Bad' is not watched for changes"),
    "hash of an object": (block_hashes.BlockReader, "_object", "Object 'Bad' is not watched for changes"),
    "hash of faces": (digest.Digest, "faces", "Object 'Bad' is not watched for changes"),
}


@pytest.mark.parametrize("step", FAULTS)
def test_unexpected_errors_concern_one_object_alone(
    step: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    owner, name, said = FAULTS[step]
    original: Callable[..., Any] = getattr(owner, name)
    error = KeyError(f"broken {step}")

    def faulty(*values: Any, **more: Any) -> Any:
        if any(each.startswith("Bad") for each in _names(values)):
            raise error
        return original(*values, **more)

    lamp("SUN", 2.0)
    for each, x in (("Good", 0.0), ("Bad", 2.0)):
        paint = reading("attribute_name", "Color")
        paint.name = each
        tree = paint.node_tree
        tree.links.new(read_by("ObjectInfo", "Random")(tree), tree.nodes["Emission"].inputs["Strength"])
        item = cuboid(each, *CUBE, paint)
        item.location.x = x
        item.data.uv_layers.new(name="UVMap")
        item.data.attributes.new("Color", "FLOAT_COLOR", "CORNER")
    monkeypatch.setattr(owner, name, faulty)
    with caplog.at_level(logging.WARNING, "patchnet"):
        made = lit(**SMALL)
    (sentence,) = [text for text in made.warnings if "unexpected" in text]
    assert sentence.startswith(f"{said}, after an unexpected error (KeyError: 'broken {step}')"), sentence
    assert "Good" in made.source.object_names
    assert ("Bad" in made.source.object_names) == ("left out" not in said)
    assert "Traceback" in caplog.text and f"broken {step}" in caplog.text
    lights_hash(bpy.context.evaluated_depsgraph_get())
    if "left out" in said:
        bpy.data.objects["Good"].hide_render = True
        with pytest.raises(EmptySelectionError, match="Object 'Bad' is left out"):
            lit(**SMALL)
