# SPDX-License-Identifier: GPL-3.0-or-later
"""Composition of a furnished scene in an empty file."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Vector

from ...patchnet_addon.furniture.floor_plan import FloorPlan, Placement
from ...patchnet_addon.furniture.garden import plan_garden
from ...patchnet_addon.furniture.interior import plan_interior
from ...patchnet_addon.furniture.kinds import SITTING, kind_of
from ...patchnet_addon.furniture.library import Library, Piece
from ...patchnet_addon.furniture.stock import Stock
from ..demo_scene.geometry import add_object
from ..demo_scene.lighting import build_light
from ..demo_scene.materials import principled
from .models import library_meshes
from .own_meshes import own_meshes
from .people import build_stool
from .shell import build_shell
from .yard import build_yard

INTERIOR, GARDEN = "interior", "garden"
KINDS = (INTERIOR, GARDEN)


@dataclass(frozen=True)
class Composed:
    """Composed scene: its plan, its role ("train", "test", "free"), and in words what is of no library."""

    plan: FloorPlan
    role: str
    own: str


def compose_scene(libraries: Sequence[Library], kind: str, seed: int) -> Composed:
    """Replace whatever is open by a furnished room or a garden; every random choice from `seed` and libraries.

    Raises SettingError for libraries that are not to be mixed, LibraryFileError for models that cannot be read.
    """
    # The libraries count too: scenes for training and for testing share no room, whatever their seeds are.
    names = zlib.crc32("\n".join(library.name for library in libraries).encode())
    choice, layout, looks = np.random.default_rng([seed, names]).spawn(3)
    stock = Stock(libraries, choice)
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    shell, furniture, light = (_part(scene, name) for name in ("Shell", "Furniture", "Light"))
    if kind == INTERIOR:
        room = plan_interior(stock, layout)
        plan, own = room.plan, "floor, ceiling, walls, windows, door frame"
        build_shell(shell, room, looks)
    else:
        plan, own = plan_garden(stock, layout), "lawn, path, grass, fence"
        build_yard(shell, plan, looks)
    pieces = list(dict.fromkeys(placement.piece for placement in plan.placements))
    mine = [piece for piece in pieces if piece.library is None]
    meshes = library_meshes(pieces) | own_meshes(mine, looks)
    stools = _place_all(furniture, plan.placements, meshes)
    build_light(scene, light)
    _add_camera(scene, plan, inside=kind == INTERIOR)
    own = ", ".join([own, *(piece.model for piece in mine), *["stools"] * bool(stools)])
    return Composed(plan, stock.role, own)


def _part(scene: bpy.types.Scene, name: str) -> bpy.types.Collection:
    collection = bpy.data.collections.new(name)
    scene.collection.children.link(collection)
    return collection


def _place_all(
    collection: bpy.types.Collection, placements: Sequence[Placement], meshes: dict[Piece, bpy.types.Mesh]
) -> int:
    """Set an object for each placement; returns how many stools were built for people who sit."""
    stools = 0
    for number, placement in enumerate(placements, 1):
        item = add_object(collection, f"{number:03d} {placement.piece.name}", meshes[placement.piece])
        items = [item]
        if kind_of(placement.piece) == SITTING:
            paint = principled("Stool", (0.45, 0.33, 0.24)) if not stools else bpy.data.materials["Stool"]
            stool = build_stool(collection, meshes[placement.piece], paint, f"{number:03d} Stool")
            items += [] if stool is None else [stool]
            stools += stool is not None
        for part in items:
            part.location, part.rotation_euler = placement.at, (0.0, 0.0, placement.angle)
    return stools


def _add_camera(scene: bpy.types.Scene, plan: FloorPlan, *, inside: bool) -> None:
    """Add a camera in the corner at -x, -y of a room, or one that looks at a garden from outside."""
    x, y = plan.width / 2, plan.depth / 2
    at = Vector((-x + 0.15, -y + 0.15, 1.9) if inside else (-0.7 * x, -2.1 * y, 0.9 * y))
    target = Vector((0.35 * x, 0.4 * y, 0.7) if inside else (0.0, -0.1 * y, 0.8))
    data = bpy.data.cameras.new("View")
    data.sensor_fit, data.angle, data.clip_start = "AUTO", 1.5 if inside else 0.9, 0.01
    item = add_object(scene.collection, "View", data)
    item.location, item.rotation_euler = at, (at - target).to_track_quat("Z", "Y").to_euler()
    scene.camera = item
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = 768, 512
    scene.view_settings.view_transform = "Standard"
    scene.unit_settings.system = "METRIC"
