# SPDX-License-Identifier: GPL-3.0-or-later
"""Background of a camera's picture: the world as Cycles shows it to cameras, black, or none for a transparent film."""

from __future__ import annotations

from typing import NamedTuple

import bpy
import numpy as np

from ...patchnet_addon.image.background import BLACK
from ...patchnet_addon.runtime.errors import SceneError
from ...patchnet_addon.runtime.progress import Steps
from ...patchnet_addon.tracing.camera import Camera
from ..scene_access.blender_version import tree_in_use
from ..schema.values import AUTO, BLACK_BACKGROUND, TRANSPARENT
from .daylight import SKY_COLOR, SKY_STRENGTH, has_light
from .environment import SAMPLES, world_view

_UNSEEN = "Black is shown behind objects: {}"
DAYLIGHT = np.array(SKY_COLOR, np.float32) * np.float32(SKY_STRENGTH)  # of a scene without light


def world_color(world: bpy.types.World | None) -> np.ndarray | None:
    """Scene-linear colour (3,) float32 that cameras see of an evaluated world; None if it is not one colour."""
    if world is None or not getattr(getattr(world, "cycles_visibility", None), "camera", True):
        return BLACK
    tree = tree_in_use(world)
    if tree is None:
        return np.array(world.color, np.float32)
    output = tree.get_output_node("CYCLES")
    surface = output.inputs["Surface"] if output else None
    if surface is None or not surface.is_linked:
        return BLACK
    node = surface.links[0].from_node
    if node.mute or surface.links[0].is_muted:
        return None
    if node.type != "BACKGROUND" or any(node.inputs[name].is_linked for name in ("Color", "Strength")):
        return None
    color = np.array(node.inputs["Color"].default_value[:3], np.float32)
    return color * np.float32(node.inputs["Strength"].default_value)


class SeenWorld(NamedTuple):
    """World as cameras see it, until the scene changes.

    color: scene-linear (3,) if it is uniform, else None. world: the evaluated one otherwise. frame: frame and subframe.
    """

    color: np.ndarray | None
    world: bpy.types.World | None
    frame: tuple[int, float]


class Background(NamedTuple):
    """Background of a picture.

    light: (P, 3) or (3,) float32, scene-linear and unexposed; None for a transparent film. warnings: why the world is
    missing.
    """

    light: np.ndarray | None
    warnings: tuple[str, ...] = ()


BLACK_GROUND = Background(BLACK)


def seen_world(depsgraph: bpy.types.Depsgraph, *, baked: bool, daylight: bool | None = None) -> SeenWorld:
    """World of an evaluated scene, or the override of its view layer.

    baked: whether Cycles lights the voxels; a scene without light then shows the sky of its bake. daylight: whether the
    scene was lit by it; None tests the scene.
    """
    scene = depsgraph.scene
    frame = scene.frame_current, scene.frame_subframe
    if baked and (not has_light(depsgraph) if daylight is None else daylight):
        return SeenWorld(DAYLIGHT, None, frame)
    world = getattr(depsgraph.view_layer, "world_override", None) or scene.world
    if not depsgraph.view_layer.use_sky:
        world = None
    if world is not None:  # the graph of a render names the original
        world = world.original.evaluated_get(depsgraph)
    color = world_color(world)
    return SeenWorld(color, world if color is None else None, frame)


def background(
    depsgraph: bpy.types.Depsgraph, camera: Camera, choice: str, *, baked: bool, daylight: bool | None = None
) -> Steps[Background]:
    """Background of a camera by the setting `choice`; baked, daylight: as for `seen_world`.

    Black with a warning without Cycles.
    """
    if choice == TRANSPARENT or (choice == AUTO and depsgraph.scene.render.film_transparent):
        return Background(None)
    if choice == BLACK_BACKGROUND:
        return BLACK_GROUND
    seen = seen_world(depsgraph, baked=baked, daylight=daylight)
    if seen.world is None:
        return Background(seen.color)
    try:
        return Background((yield from world_view(seen.world.original, seen.frame, camera, SAMPLES)))
    except SceneError as error:
        return Background(BLACK, (_UNSEEN.format(error),))
