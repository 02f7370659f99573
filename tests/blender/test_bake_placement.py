# SPDX-License-Identifier: GPL-3.0-or-later
"""Linked, hidden and instanced objects and ray visibility: the bake agrees with a render."""

from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet.tests.blender.light_scene import assert_agrees, compare
from patchnet.tests.blender.objects import collection_instance, geometry_nodes, group, lamp, link, mesh, pane, slab
from patchnet.tests.blender.shaders import glowing, grey, material, mixed, read_by, shader, shown, simple

pytestmark = pytest.mark.usefixtures("empty_scene")

SHADOW = 0.9  # contrast of a shadow


def sun() -> bpy.types.Object:
    return lamp("SUN", 3.0, angle=0.15)


def layer_of(name: str) -> bpy.types.LayerCollection:
    return bpy.context.view_layer.layer_collection.children[name]


@pytest.mark.parametrize("hidden", ["viewport", "eye", "collection eye", "collection viewport"])
def test_hidden_in_viewports_yet_rendered(hidden: str) -> None:
    """A roof and a lamp that only renders show."""
    slab()
    items = pane("Roof", grey(0.0)), sun(), lamp("POINT", 5.0, (-0.5, -0.5, 0.5), shadow_soft_size=0.1)
    shades = group("Hidden", *items)
    for item in items:
        item.hide_viewport = hidden == "viewport"
        if hidden == "eye":
            item.hide_set(True)
    layer_of("Hidden").hide_viewport = hidden == "collection eye"
    shades.hide_viewport = hidden == "collection viewport"
    assert_agrees(compare(64), contrast=SHADOW)


@pytest.mark.parametrize("hidden", ["object", "collection", "excluded"])
def test_shown_in_viewports_yet_not_rendered(hidden: str) -> None:
    slab()
    sun()
    items = pane("Roof", grey(0.0)), lamp("POINT", 5.0, (-0.5, -0.5, 0.5), shadow_soft_size=0.1)
    unseen = group("Unseen", *items)
    for item in items:
        item.hide_render = hidden == "object"
    unseen.hide_render = hidden == "collection"
    layer_of("Unseen").exclude = hidden == "excluded"
    found = compare()
    assert_agrees(found)
    assert np.ptp(found.rendered) < 1e-3, "neither roof nor lamp may count"


@pytest.mark.parametrize("ray", ["camera", "shadow", "diffuse", "transmission", "glossy"])
def test_rays_that_do_not_meet_an_object(ray: str) -> None:
    """A bright, shadowing wall without one kind of ray."""
    slab()
    wall = pane("Wall", mixed_emission())
    setattr(wall, f"visible_{ray}", False)
    sun().rotation_euler.y = 0.3
    assert_agrees(compare(512), contrast=0.05)


def mixed_emission() -> bpy.types.Material:
    result, tree = material("Bright")
    shown(tree, mixed(tree, shader(tree, "BsdfDiffuse"), shader(tree, "Emission", Strength=0.5), 0.3))
    return result


@pytest.mark.parametrize("flag", ["is_shadow_catcher", "is_holdout"])
def test_catchers_and_holdouts_shadow(flag: str) -> None:
    slab()
    setattr(pane("Roof", grey(0.3)), flag, True)
    sun().rotation_euler.y = 0.3
    assert_agrees(compare(), contrast=SHADOW)


@pytest.mark.parametrize("kind", ["holdout", "indirect_only"])
def test_collections_of_the_view_layer(kind: str) -> None:
    slab()
    group("Roofs", pane("Roof", grey(0.0)))
    setattr(layer_of("Roofs"), kind, True)
    sun().rotation_euler.y = 0.3
    assert_agrees(compare(), contrast=SHADOW)


def test_linked_library(tmp_path: Path) -> None:
    """Surface, roof, lamp and materials from another file; one object by an instanced collection."""
    path = tmp_path / "library.blend"
    slab(paint=grey(0.7))
    group("Linked", pane("Roof", grey(0.0)), lamp("POINT", 5.0, (-0.5, -0.5, 0.5), shadow_soft_size=0.05))
    bpy.data.libraries.write(str(path), {bpy.data.objects["Floor"], bpy.data.collections["Linked"]})
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(str(path), link=True) as (_, linked):
        linked.objects, linked.collections = ["Floor"], ["Linked"]
    bpy.context.scene.collection.objects.link(linked.objects[0])
    collection_instance(linked.collections[0])
    sun()
    assert bpy.data.objects["Floor"].library and bpy.data.materials["Grey"].library
    assert_agrees(compare(), contrast=SHADOW)


def test_instances_of_lamps_roofs_and_surfaces() -> None:
    """Two instances of a collection with a slab, a roof and a lamp, one of them mirrored."""
    items = (
        slab(low=(-0.45, -0.8), high=(0.45, 0.8)),
        pane("Roof", grey(0.0), z=0.4, scale=(0.2, 0.5, 1)),
        lamp("POINT", 5.0, (0.1, 0.3, 0.6), shadow_soft_size=0.02),
    )
    items[1].location.x = 0.2
    source = group("Source", *items)
    layer_of("Source").exclude = True
    for number, x in enumerate((-0.5, 0.5)):
        collection_instance(source, f"Instance {number}", (x, 0.0, 0.0)).scale.x = 1.0 - 2.0 * number
    sun()
    assert_agrees(compare(256, ("Instance 0", "Instance 1")), contrast=SHADOW)


def test_random_numbers_and_slots_of_geometry_nodes_instances() -> None:
    """Tiles that geometry nodes place on points glow by their random numbers, as rendered."""
    tile = slab("Tile", glowing(read_by("ObjectInfo", "Random")), (-0.24, -0.24), (0.24, 0.24))
    tile.location.z = -9
    tile.hide_render = True
    points = [(x, y, 0.0) for x in (-0.75, -0.25, 0.25, 0.75) for y in (-0.75, -0.25, 0.25, 0.75)]
    item = link(mesh("Floor", points, []))
    nodes, given, made = geometry_nodes(item)
    place, info = nodes.nodes.new("GeometryNodeInstanceOnPoints"), nodes.nodes.new("GeometryNodeObjectInfo")
    info.inputs["Object"].default_value = tile
    nodes.links.new(given, place.inputs["Points"])
    nodes.links.new(info.outputs["Geometry"], place.inputs["Instance"])
    nodes.links.new(place.outputs[0], made)
    assert_agrees(compare(), contrast=0.3)


def test_slots_of_objects_and_several_materials() -> None:
    """Two slabs of one mesh, one with a material of its own in the first slot; tops and halves differ."""
    quads = [(x, y, 0.0) for x in (-0.4, 0.0, 0.4) for y in (-0.8, 0.8)]
    first = link(mesh("First", quads, [(0, 2, 3, 1), (2, 4, 5, 3)], grey(0.2)), (-0.5, 0.0, 0.0))
    first.data.materials.append(grey(0.8))
    first.data.polygons[1].material_index = 1
    second = link(bpy.data.objects.new("Second", first.data), (0.5, 0.0, 0.0))
    second.material_slots[0].link = "OBJECT"
    second.material_slots[0].material = simple("Emission", Strength=0.4)
    sun()
    found = compare(names=("First", "Second"))
    assert_agrees(found, contrast=0.5)
    assert len(set(found.rendered[4].round(2))) == 3, "three materials side by side"


def test_scattering_volumes() -> None:
    """A box of fog over half of the surface, and a spot that shines through it."""
    slab()
    fog, tree = material("Fog")
    scatter = shader(tree, "VolumeScatter", Density=2.0)
    output = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
    tree.links.new(scatter, output.inputs["Volume"])
    box = slab("Fog", fog, (-0.9, -0.5), (0.1, 0.5))
    box.location.z = 0.5
    lamp("SPOT", 60.0, (0.5, 0.0, 1.5), spot_size=1.5, shadow_soft_size=0.05).rotation_euler.y = 0.4
    bpy.context.scene.cycles.volume_bounces = 1
    assert_agrees(compare(), contrast=0.3)
