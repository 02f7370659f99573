# SPDX-License-Identifier: GPL-3.0-or-later
"""Light linking and shadow linking, and view layers: the bake agrees with a render."""

from collections.abc import Sequence

import bpy
import numpy as np
import pytest

from patchnet.tests.blender.light_scene import assert_agrees, compare, select
from patchnet.tests.blender.objects import collection_instance, lamp, moved_to, pane, slab
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot
from patchnet.tests.blender.shaders import grey, simple

pytestmark = pytest.mark.usefixtures("empty_scene")

BOTH = ("Left", "Right")


def halves() -> tuple[bpy.types.Object, bpy.types.Object]:
    """Two slabs under a dim lamp that shines on both."""
    lamp("POINT", 3.0, (0.0, 0.0, 0.8), shadow_soft_size=0.2)
    return slab("Left", high=(0.0, 1.0)), slab("Right", low=(0.0, -1.0))


def receivers(items: Sequence[bpy.types.Object], state: str = "INCLUDE") -> bpy.types.Collection:
    result = bpy.data.collections.new("Receivers")
    for item in items:
        result.objects.link(item)
        result.collection_objects[-1].light_linking.link_state = state
    return result


def assert_halves(lit: int) -> None:
    """Bake is render, half `lit` much brighter than the other, and the scene as before."""
    select(BOTH)
    before = scene_snapshot()
    found = compare(names=BOTH)
    assert_unchanged(before)
    assert_agrees(found)
    means = found.rendered[:, :4].mean(), found.rendered[:, 4:].mean()
    assert means[lit] > 2.0 * means[1 - lit]


def test_receivers_in_a_nested_collection() -> None:
    """Objects in a child have the state of the child."""
    left, right = halves()
    outer = bpy.data.collections.new("Outer")
    outer.children.link(receivers([left]))
    outer.collection_children[0].light_linking.link_state = "EXCLUDE"
    outer.objects.link(right)
    lamp("SUN", 3.0, angle=0.0).light_linking.receiver_collection = outer
    assert_halves(1)


def test_receivers_of_an_emitting_mesh() -> None:
    left, _ = halves()
    emitter = pane("Emitter", simple("Emission", Strength=4.0))
    emitter.location.x = 0.0
    emitter.light_linking.receiver_collection = receivers([left])
    bpy.context.scene.cycles.diffuse_bounces = 0
    found = compare(256, BOTH)
    assert_agrees(found)
    assert found.rendered[:, 0].mean() > 2.0 * found.rendered[:, -1].mean()


def test_instances_are_receivers_as_their_instancer() -> None:
    """Two instances of one slab: the sun shines on the second only."""
    item = slab("Tile", low=(-0.5, -1.0), high=(0.5, 1.0))
    tiles = moved_to(bpy.data.collections.new("Tiles"), item)
    lamp("POINT", 3.0, (0.0, 0.0, 0.8), shadow_soft_size=0.2)
    places = [collection_instance(tiles, name, (x, 0.0, 0.0)) for name, x in zip(BOTH, (-0.5, 0.5), strict=True)]
    lamp("SUN", 3.0, angle=0.0).light_linking.receiver_collection = receivers(places[1:])
    assert_halves(1)


@pytest.mark.parametrize("state", ["INCLUDE", "EXCLUDE"])
def test_objects_that_shadow_one_lamp(state: str) -> None:
    """Two roofs, of which the sun knows one."""
    halves()
    roofs = [pane(f"Roof {x}", grey(0.0), 0.5, (0.5, 1.0, 1.0)) for x in (-0.5, 0.5)]
    for roof, x in zip(roofs, (-0.5, 0.5), strict=True):
        roof.location.x = x
    lamp("SUN", 3.0, angle=0.1).light_linking.blocker_collection = receivers(roofs[:1], state)
    assert_halves(1 if state == "INCLUDE" else 0)


def test_material_of_the_view_layer() -> None:
    """An override of all materials counts, as in renders."""
    slab(paint=grey(0.9))
    pane("Roof", grey(0.9))
    lamp("SUN", 3.0, angle=0.1)
    bpy.context.view_layer.material_override = grey(0.3)
    found = compare()
    assert_agrees(found)
    assert found.bright == pytest.approx(3.0 * 0.3 / np.pi, rel=0.05)
