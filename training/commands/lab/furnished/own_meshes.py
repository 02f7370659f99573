# SPDX-License-Identifier: GPL-3.0-or-later
"""Pieces that the script builds where libraries lack a kind: shapes by kind, scaled to their sizes."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np

from .....operators.computing import demo_textures as textures
from .....operators.demo_scene.geometry import Shape, ball, box, join, lathe, place, tube
from .....operators.demo_scene.materials import principled, to_image
from .....operators.demo_scene.plants import bush
from . import kinds
from .library import Piece
from .models import fit_mesh

_Part = tuple[Shape, str]  # shape and material, see `_materials`
_GREENS = ((0.27, 0.45, 0.16), (0.34, 0.53, 0.20), (0.22, 0.38, 0.15))


def own_meshes(pieces: list[Piece], rng: np.random.Generator) -> dict[Piece, bpy.types.Mesh]:
    """Build each piece once, as one mesh of its size."""
    if not pieces:
        return {}
    materials = _materials(rng)
    return {piece: _mesh(piece, _BUILDERS[piece.model](rng), materials) for piece in pieces}


def _mesh(piece: Piece, parts: list[_Part], materials: dict[str, bpy.types.Material]) -> bpy.types.Mesh:
    """Join parts of several materials to one mesh."""
    shape = join(part if part.uv is not None else Shape(part.vertices, part.faces) for part, _ in parts)
    collection = bpy.data.collections.new("parts")
    names = list(dict.fromkeys(name for _, name in parts))
    item = place(collection, piece.name, shape, materials[names[0]])
    mesh = item.data
    for name in names[1:]:
        mesh.materials.append(materials[name])
    numbers = [names.index(name) for part, name in parts for _ in part.faces]
    mesh.polygons.foreach_set("material_index", np.array(numbers, np.int32))
    _keep_leaf_coordinates(mesh, parts)
    bpy.data.objects.remove(item)
    bpy.data.collections.remove(collection)
    fit_mesh(mesh, piece.size)
    return mesh


def _keep_leaf_coordinates(mesh: bpy.types.Mesh, parts: list[_Part]) -> None:
    """Set texture coordinates of parts that have them; `join` keeps them only if all parts do."""
    layer = mesh.uv_layers[0].data
    first = 0
    for part, _ in parts:
        corners = [corner for face in part.faces for corner in face]
        if part.uv is not None:
            for number, corner in enumerate(corners):
                layer[first + number].uv = part.uv[corner]
        first += len(corners)


def _materials(rng: np.random.Generator) -> dict[str, bpy.types.Material]:
    grain = to_image("Own wood", textures.wood(rng, (0.80, 0.80, 0.80)))
    leaves = to_image("Own leaves", textures.sprig(rng, _GREENS, 5, 0.18, 0.40))
    return {
        "wood": principled("Own wood", tuple(rng.uniform((0.4, 0.28, 0.2), (0.75, 0.58, 0.42))), grain),
        "metal": principled("Own metal", (0.25, 0.25, 0.27), roughness=0.6),
        "cloth": principled("Own cloth", tuple(rng.uniform(0.25, 0.75, 3))),
        "clay": principled("Own clay", (0.72, 0.45, 0.32)),
        "bark": principled("Own bark", (0.42, 0.34, 0.27)),
        "paper": principled("Own paper", (0.92, 0.88, 0.78)),
        "leaves": principled("Own leaves", image=leaves, alpha=True),
    }


def _legs(width: float, depth: float, height: float, thick: float) -> Shape:
    """Four legs under the corners of a rectangle about the origin."""
    x, y = width / 2 - thick, depth / 2 - thick
    return join(
        box((sx * x - thick / 2, sy * y - thick / 2, 0), (sx * x + thick / 2, sy * y + thick / 2, height))
        for sx in (-1, 1)
        for sy in (-1, 1)
    )


def _table(rng: np.random.Generator) -> list[_Part]:
    return [(box((-0.85, -0.45, 0.71), (0.85, 0.45, 0.75)), "wood"), (_legs(1.7, 0.9, 0.71, 0.06), "metal")]


def _chair(rng: np.random.Generator) -> list[_Part]:
    """Chair whose back has bars of 15 mm."""
    bars = [box((x - 0.0075, 0.225, 0.45), (x + 0.0075, 0.24, 0.9)) for x in np.linspace(-0.18, 0.18, 6)]
    frame = [box((-0.23, 0.215, 0.88), (0.23, 0.25, 0.92)), _legs(0.46, 0.5, 0.43, 0.035)]
    return [(join([*frame, *bars]), "wood"), (box((-0.23, -0.25, 0.43), (0.23, 0.25, 0.46)), "cloth")]


def _shelf(rng: np.random.Generator) -> list[_Part]:
    """Bookcase of six boards with books of many sizes."""
    sides = [box((x - 0.012, -0.17, 0), (x + 0.012, 0.17, 1.95)) for x in (-0.638, 0.638)]
    levels = np.linspace(0.08, 1.926, 6)
    boards = [box((-0.626, -0.17, z), (0.626, 0.17, z + 0.024)) for z in levels]
    parts = [(join([*sides, *boards, box((-0.626, 0.16, 0), (0.626, 0.17, 1.95))]), "wood")]
    for z in levels[:-1]:
        x = -0.6
        while x < rng.uniform(0.1, 0.55):
            thick, deep, high = rng.uniform(0.012, 0.05), rng.uniform(0.14, 0.22), rng.uniform(0.17, 0.29)
            parts.append((box((x, 0.15 - deep, z + 0.024), (x + thick, 0.15, z + 0.024 + high)), _cover(rng)))
            x += thick + 0.001
    return parts


def _cover(rng: np.random.Generator) -> str:
    return str(rng.choice(["cloth", "clay", "paper", "metal"]))


def _floor_lamp(rng: np.random.Generator) -> list[_Part]:
    pole = join([lathe([(0.16, 0), (0.16, 0.02), (0.012, 0.03), (0.012, 1.4)], 20)])
    return [(pole, "metal"), (lathe([(0.21, 1.3), (0.13, 1.65)], 24), "paper")]


def _hanging_lamp(rng: np.random.Generator) -> list[_Part]:
    return [(lathe([(0.006, 0.2), (0.006, 0.7)], 8), "metal"), (lathe([(0.25, 0), (0.2, 0.12), (0.02, 0.22)]), "paper")]


def _plant(rng: np.random.Generator) -> list[_Part]:
    pot = lathe([(0.02, 0), (0.15, 0.01), (0.2, 0.36), (0.17, 0.36), (0.16, 0.3), (0.01, 0.31)], 24)
    return [(pot, "clay"), (bush(rng, 150, (0.3, 0.3, 0.4), (0, 0, 0.85), 0.24, 0.55), "leaves")]


def _bowl(rng: np.random.Generator) -> list[_Part]:
    bowl = lathe([(0.05, 0), (0.13, 0.1), (0.122, 0.1), (0.045, 0.012)], 24)
    fruit = [ball(0.035).moved((0.055 * np.cos(a), 0.055 * np.sin(a), 0.06)) for a in (0.3, 2.1, 4.2)]
    return [(bowl, "paper"), (join(fruit), "clay")]


def _tree(rng: np.random.Generator) -> list[_Part]:
    top = np.array([0.05, 0.0, 1.6])
    wood = [tube(np.array([(0, 0, 0), (0.05, 0.02, 0.8), top]), np.array([0.11, 0.09, 0.07]), 10)]
    crowns = []
    for number in range(9):
        angle = 2.39996 * number
        tip = top + np.array([np.cos(angle), np.sin(angle), 0.7 + 0.4 * (number % 3)]) * rng.uniform(0.7, 0.95)
        wood.append(tube(np.array([top, (top + tip) / 2 + (0, 0, 0.08), tip]), np.array([0.05, 0.03, 0.015]), 6))
        crowns.append(bush(rng, 110, (0.5, 0.5, 0.4), tip, 0.26, 0.7))
    return [(join(wood), "bark"), (join(crowns), "leaves")]


def _bush(rng: np.random.Generator) -> list[_Part]:
    return [(bush(rng, 420, (0.5, 0.5, 0.45), (0, 0, 0.5), 0.2, 0.7), "leaves")]


def _bench(rng: np.random.Generator) -> list[_Part]:
    """Bench of slats of 25 mm."""
    seat = [box((-0.8, y, 0.42), (0.8, y + 0.06, 0.445)) for y in np.linspace(-0.27, 0.15, 6)]
    back = [box((-0.8, 0.24, z), (0.8, 0.265, z + 0.06)) for z in np.linspace(0.52, 0.79, 4)]
    feet = [
        box((x - 0.02, y, 0), (x + 0.02, y + 0.03, z)) for x in (-0.7, 0.7) for y, z in ((-0.24, 0.42), (0.21, 0.8))
    ]
    return [(join([*seat, *back]), "wood"), (join(feet), "metal")]


_BUILDERS: dict[str, Callable[[np.random.Generator], list[_Part]]] = {
    kinds.TABLE: _table,
    kinds.COFFEE_TABLE: _table,
    kinds.CHAIR: _chair,
    kinds.SHELF: _shelf,
    kinds.FLOOR_LAMP: _floor_lamp,
    kinds.HANGING_LAMP: _hanging_lamp,
    kinds.PLANT: _plant,
    kinds.SMALL: _bowl,
    kinds.TREE: _tree,
    kinds.BUSH: _bush,
    kinds.GARDEN: _bench,
}
