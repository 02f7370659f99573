# SPDX-License-Identifier: GPL-3.0-or-later
"""Composition of a scene of procedural structures in an empty file."""

from __future__ import annotations

import string

import bpy
import numpy as np

from ..demo_scene import textures
from ..demo_scene.geometry import add_object, box, place
from ..demo_scene.lighting import build_light
from ..demo_scene.materials import principled
from .kinds import CHEQUERS, KINDS, TEXT

_SIDE, _PIECES = 6, 2  # pieces along each side of the ground, and above each other
_STEP = 1.5  # metres between pieces
_EXTENT = _SIDE * _STEP  # a voxel of depth 10 is a thousandth of it
_THINNEST, _THICKEST = 0.35 / 1024, 12.0 / 1024  # of parts, in shares of the extent
_MATERIALS = 14


def compose_structures(seed: int) -> int:
    """Replace whatever is open by structures of all kinds, sizes and colors; returns how many there are.

    Thicknesses are spread evenly over their logarithm, from a third of a voxel of an octree of depth 10 to 12 voxels.
    A third of the structures has a wall behind them at one to fifty times their thickness.
    """
    layout, looks = np.random.default_rng(seed).spawn(2)
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    structures, light = (bpy.data.collections.new(name) for name in ("Structures", "Light"))
    for collection in (structures, light):
        scene.collection.children.link(collection)
    materials = _materials(looks)
    half = _EXTENT / 2 + 0.2
    place(structures, "Ground", box((-half, -half, -0.1), (half, half, 0.0)), _chequers(looks, 1 / 60), repeat=1.0)
    names = [*KINDS] * (_SIDE * _SIDE * _PIECES // len(KINDS) + 1)
    order = layout.permutation(len(names))
    number = 0
    for x in range(_SIDE):
        for y in range(_SIDE):
            for z in range(_PIECES):
                at = (np.array([x, y, z]) - (_SIDE / 2 - 0.5, _SIDE / 2 - 0.5, -0.55)) * _STEP
                at += layout.uniform(-0.15, 0.15, 3)
                _add_structure(structures, names[order[number]], number + 1, at, layout, looks, materials)
                number += 1
    build_light(scene, light)
    return number


def _add_structure(
    collection: bpy.types.Collection,
    kind: str,
    number: int,
    at: np.ndarray,
    layout: np.random.Generator,
    looks: np.random.Generator,
    materials: list[bpy.types.Material],
) -> None:
    thick = _EXTENT * float(np.exp(layout.uniform(np.log(_THINNEST), np.log(_THICKEST))))
    turn = layout.uniform(-np.pi, np.pi, 3) * (0.25, 0.25, 1.0)  # mostly upright, as things are
    material = materials[looks.integers(len(materials))]
    if kind == CHEQUERS:
        material = _chequers(looks, 2.5 * thick)
    parts = [place(collection, f"{number:03d} {kind}", KINDS[kind](layout, thick), material, repeat=1.0)]
    if kind == TEXT:
        parts.append(_add_text(collection, number, layout, thick, materials[looks.integers(len(materials))]))
    elif layout.random() < 0.35:
        away = thick * float(np.exp(layout.uniform(0.0, np.log(50.0))))
        wall = box((-0.6, 0.0, -0.6), (0.6, 0.02, 0.6)).moved((0.0, min(away, 0.5), 0.0))
        parts.append(place(collection, f"{number:03d} wall", wall, materials[looks.integers(len(materials))]))
    for part in parts:
        part.location, part.rotation_euler = at, turn


def _add_text(
    collection: bpy.types.Collection, number: int, rng: np.random.Generator, thick: float, ink: bpy.types.Material
) -> bpy.types.Object:
    """Lines of letters on a panel; strokes are about as wide as `thick`."""
    size = min(10.0 * thick, 0.35)
    columns, rows = max(int(1.1 / (0.6 * size)), 2), max(int(1.1 / size), 1)
    letters = rng.choice(list(string.ascii_letters + string.digits + "   .,:"), (min(rows, 40), min(columns, 60)))
    curve = bpy.data.curves.new("Text", "FONT")
    curve.body, curve.size = "\n".join("".join(line) for line in letters), size
    written = add_object(collection, "Text", curve)
    bpy.context.view_layer.update()
    mesh = bpy.data.meshes.new_from_object(written.evaluated_get(bpy.context.evaluated_depsgraph_get()))
    bpy.data.objects.remove(written)
    points = np.empty(3 * len(mesh.vertices))
    mesh.vertices.foreach_get("co", points)
    flat = points.reshape(-1, 3)
    upright = np.column_stack([flat[:, 0] - 0.55, np.full(len(flat), -0.6 * thick), flat[:, 1] + 0.5 - size])
    mesh.vertices.foreach_set("co", upright.ravel())
    mesh.materials.clear()
    mesh.materials.append(ink)
    mesh.update()
    return add_object(collection, f"{number:03d} letters", mesh)


def _materials(rng: np.random.Generator) -> list[bpy.types.Material]:
    """Plain colors, from nearly black to nearly white."""
    shades = np.linspace(0.08, 0.95, _MATERIALS)
    tints = np.clip(shades[:, None] * rng.uniform(0.75, 1.25, (_MATERIALS, 3)), 0.02, 0.98)
    return [principled(f"Paint {number}", tuple(tint)) for number, tint in enumerate(tints)]


def _chequers(rng: np.random.Generator, field: float) -> bpy.types.Material:
    """Chequers of `field` metres in two colors, on a texture of one metre."""
    count = int(np.clip(round(1.0 / field), 2, 256))
    size = count * max(512 // count, 2)
    number = np.arange(size) * count // size
    odd = ((number[:, None] + number[None, :]) % 2)[..., None]
    dark, bright = rng.uniform(0.03, 0.4, 3), rng.uniform(0.5, 0.97, 3)
    return principled("Chequers", image=textures.to_image("Chequers", np.where(odd, dark, bright)))
