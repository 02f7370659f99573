# SPDX-License-Identifier: GPL-3.0-or-later
"""Composition of a furnished scene in an empty file, and its .glb file."""

from __future__ import annotations

import shutil
import tempfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from .....operators.demo_scene.geometry import add_object, box, join, place
from .....operators.demo_scene.materials import principled
from .....patchnet_addon.runtime.errors import OutputError
from .....patchnet_addon.runtime.replace import replaced_path
from ....file_kinds import GLB
from .floor_plan import FloorPlan, Placement
from .kinds import SITTING, Stock, kind_of
from .library import Library, Piece
from .models import library_meshes, vertices_of
from .own_meshes import own_meshes
from .plans import plan_garden, plan_interior
from .shell import build_shell, build_yard


@dataclass(frozen=True)
class Composed:
    """Composed scene: its plan, its role ("train", "test", "free"), and the names of parts built by script."""

    plan: FloorPlan
    role: str
    own: str


def compose_scene(libraries: Sequence[Library], kind: str, seed: int) -> Composed:
    """Replace the open file by a furnished room or garden; `seed` and libraries determine every random choice.

    Raises SettingError for libraries that must not be mixed, LibraryFileError for models that cannot be read.
    """
    # With the libraries' names, scenes for training and for testing share no room for any seeds.
    names = zlib.crc32("\n".join(library.name for library in libraries).encode())
    choice, layout, looks = np.random.default_rng([seed, names]).spawn(3)
    stock = Stock(libraries, choice)
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    shell, furniture = (_part(scene, name) for name in ("Shell", "Furniture"))
    if kind == "interior":
        plan, openings = plan_interior(stock, layout)
        own = "floor, ceiling, walls, windows, door frame"
        build_shell(shell, plan, openings, looks)
    else:
        plan, own = plan_garden(stock, layout), "lawn, path, grass, fence"
        build_yard(shell, plan, looks)
    pieces = list(dict.fromkeys(placement.piece for placement in plan.placements))
    mine = [piece for piece in pieces if piece.library is None]
    meshes = library_meshes(pieces) | own_meshes(mine, looks)
    stools = _place_all(furniture, plan.placements, meshes)
    own = ", ".join([own, *(piece.model for piece in mine), *["stools"] * bool(stools)])
    return Composed(plan, stock.role, own)


def _part(scene: bpy.types.Scene, name: str) -> bpy.types.Collection:
    collection = bpy.data.collections.new(name)
    scene.collection.children.link(collection)
    return collection


def _place_all(
    collection: bpy.types.Collection, placements: Sequence[Placement], meshes: dict[Piece, bpy.types.Mesh]
) -> int:
    """Add an object for each placement; returns the number of stools built for sitting people."""
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


_BACK_SHARE, _LOWEST = 0.3, 0.25  # share of a sitting person's depth, from the back; metres


def build_stool(
    collection: bpy.types.Collection, person: bpy.types.Mesh, material: bpy.types.Material, name: str
) -> bpy.types.Object | None:
    """Build a stool under a person of `models.py` who sits with the back towards +y; None if the person is too low."""
    points = vertices_of(person)
    low, high = points.min(axis=0), points.max(axis=0)
    back = points[points[:, 1] > high[1] - _BACK_SHARE * (high[1] - low[1])]
    height = float(back[:, 2].min())
    if height < _LOWEST:
        return None
    (x0, y0, _), (x1, y1, _) = back.min(axis=0), back.max(axis=0)
    legs = [box((x, y, 0.0), (x + 0.03, y + 0.03, height - 0.04)) for x in (x0, x1 - 0.03) for y in (y0, y1 - 0.03)]
    shape = join([box((x0, y0, height - 0.04), (x1, y1, height)), *legs])
    return place(collection, name, shape, material)


def save_composed(path: Path) -> None:
    """Write the open scene with its images to `path`, a .glb file; raises OutputError if it cannot be written."""
    with tempfile.TemporaryDirectory(prefix="patchnet-") as folder, replaced_path(path, GLB) as temporary:
        made = Path(folder) / "scene.glb"
        try:
            _write(made)
        except RuntimeError as cause:
            raise OutputError(f"{path} cannot be written ({cause}): choose another folder or make room") from cause
        shutil.copyfile(made, temporary)


def _write(path: Path) -> None:
    if not hasattr(bpy.types, "EXPORT_SCENE_OT_gltf"):
        import addon_utils

        addon_utils.enable("io_scene_gltf2", default_set=False)
    bpy.ops.export_scene.gltf(filepath=str(path), export_format="GLB", export_lights=False, export_cameras=False)
