# SPDX-License-Identifier: GPL-3.0-or-later
"""Furniture of the courtyard: table and cloth, chairs, objects on the table, fountain, door and sign."""

from __future__ import annotations

import bpy
import numpy as np

from .geometry import (
    Shape,
    add_object,
    array,
    ball,
    bevel,
    box,
    curve,
    join,
    lathe,
    place,
    sheet,
    show_collection,
    solidify,
    tube,
)
from .masonry import ARCADE_Y, INSIDE, PLINTH, Materials

TABLE = (-1.7, -1.35)
_TOP = 0.78
_HALF = (1.05, 0.52)  # half length and half width of the table's top
_GAP = 0.007  # height of the cloth above the table


def build_table(collection: bpy.types.Collection, materials: Materials, rng: np.random.Generator) -> None:
    """Dark table with a white cloth that hangs over three of its edges, chairs around it."""
    x, y = TABLE
    top = box((-_HALF[0], 0, 0), (_HALF[0], 0.2, 0.04))
    plank = place(collection, "Table top", top, materials["table"], repeat=0.9)
    plank.location = (x, y - _HALF[1], _TOP - 0.04)
    bevel(plank, 0.005)
    array(plank, 5, (0, 0.21, 0))
    leg = [
        (0.03, 0.03), (0.042, 0.06), (0.03, 0.1), (0.036, 0.3), (0.05, 0.42), (0.032, 0.5), (0.05, 0.54),
        (0.05, 0.74),
    ]  # fmt: skip
    legs = [lathe(leg, 20).moved((x + sx * 0.9, y + sy * 0.4, 0)) for sx in (-1, 1) for sy in (-1, 1)]
    place(collection, "Table legs", join(legs), materials["table"], smooth=True)
    apron = [box((x - 0.9, y + s * 0.4 - 0.015, 0.64), (x + 0.9, y + s * 0.4 + 0.015, 0.74)) for s in (-1, 1)]
    place(collection, "Apron", join(apron), materials["table"], repeat=0.9)
    cloth = place(collection, "Table cloth", _cloth(rng), materials["cloth"], smooth=True)
    cloth.location = (x, y, _TOP + _GAP)
    solidify(cloth, -0.002)
    _set_table(collection, materials, x, y, _TOP + _GAP + 0.004)
    chair = _chair(materials)
    for dx, dy, angle in ((-0.5, -1.0, 0.15), (0.55, -0.98, -0.2), (-0.45, 1.0, np.pi - 0.1), (0.6, 1.05, np.pi + 0.3)):
        show_collection(collection, chair, (x + dx, y + dy, 0.03), angle)


def _cloth(rng: np.random.Generator) -> Shape:
    """Rectangle of linen laid over the table's edges: flat within, hanging in folds outside."""
    hang = 0.34
    u = np.linspace(-_HALF[0] - hang, _HALF[0] - 0.3, 132)
    v = np.linspace(-_HALF[1] - hang, _HALF[1] + hang, 96)
    v, u = np.meshgrid(v, u, indexing="ij")
    edge_u, edge_v = np.clip(u, -_HALF[0], None), np.clip(v, -_HALF[1], _HALF[1])
    out_u, out_v = u - edge_u, v - edge_v
    over = np.hypot(out_u, out_v)
    safe = np.maximum(over, 1e-9)
    corner = 2 * np.abs(out_u * out_v) / safe**2  # 1 on a corner's diagonal
    around = np.arctan2(out_v, out_u) * 0.3 + edge_u - edge_v
    fold = 0.6 * np.sin(2 * np.pi * around / 0.23) + 0.4 * np.sin(2 * np.pi * around / 0.137 + 1.0)
    drop = np.clip((over - 0.015) / hang, 0, 1.5)
    away = np.minimum(over, 0.022) + drop**1.2 * (0.04 + 0.03 * fold + 0.11 * corner)
    wrinkle = 0.0012 * (np.sin(9 * u + 3 * v + rng.uniform(0, 6)) + np.sin(-4 * u + 11 * v + rng.uniform(0, 6)))
    height = np.where(over > 0, -np.maximum(over - 0.012, 0) * 0.985, 0) + np.abs(wrinkle) * (over < 0.01)
    points = np.stack([edge_u + out_u / safe * away, edge_v + out_v / safe * away, height], -1)
    return sheet(points)


def _set_table(collection: bpy.types.Collection, materials: Materials, x: float, y: float, z: float) -> None:
    """Bottle, glasses, plates and a bowl of lemons."""
    bottle = [
        (0.036, 0), (0.037, 0.01), (0.037, 0.17), (0.03, 0.2), (0.014, 0.235), (0.013, 0.29), (0.016, 0.3),
        (0.012, 0.302),
    ]  # fmt: skip
    place(collection, "Bottle", lathe(bottle, 24).moved((x + 0.12, y + 0.1, z)), materials["glass"], smooth=True)
    plate = [(0.02, 0), (0.07, 0.002), (0.1, 0.014), (0.125, 0.02), (0.123, 0.024), (0.07, 0.008), (0.01, 0.006)]
    spots = [(-0.5, -0.32), (0.45, -0.32), (-0.45, 0.32), (0.5, 0.32)]
    for dx, dy in spots:
        place(collection, "Plate", lathe(plate, 32).moved((x + dx, y + dy, z)), materials["white"], smooth=True)
    jug = [
        (0.05, 0), (0.075, 0.03), (0.085, 0.09), (0.06, 0.16), (0.045, 0.2), (0.055, 0.23), (0.048, 0.23),
        (0.04, 0.19),
    ]  # fmt: skip
    place(collection, "Jug", lathe(jug, 28).moved((x - 0.75, y + 0.06, z)), materials["door"], smooth=True)
    bowl = [(0.06, 0), (0.065, 0.012), (0.13, 0.06), (0.16, 0.1), (0.152, 0.1), (0.12, 0.06), (0.01, 0.03)]
    place(collection, "Bowl", lathe(bowl, 32).moved((x - 0.22, y, z)), materials["clay"], smooth=True)
    heap = ((0, 0.01, 0.125), (0.07, 0.03, 0.09), (-0.06, 0.05, 0.09), (-0.03, -0.07, 0.09), (0.05, -0.05, 0.09))
    lemons = [ball(0.038, 14).moved((x - 0.22 + dx, y + dy, z + dz)) for dx, dy, dz in heap]
    place(collection, "Lemons", join(lemons), materials["lemon"], smooth=True)
    cup = [(0.022, 0), (0.03, 0.004), (0.034, 0.08), (0.031, 0.08), (0.027, 0.01), (0.005, 0.008)]
    cups = [lathe(cup, 20).moved((x + dx * 0.6, y + dy * 0.8 + 0.05, z)) for dx, dy in spots]
    place(collection, "Cups", join(cups), materials["clay"], smooth=True)


def _chair(materials: Materials) -> bpy.types.Collection:
    """Bistro chair of bent iron with a slatted seat, facing +y, as a collection to instance."""
    chair = bpy.data.collections.new("Chair")
    t = np.linspace(0, np.pi, 24)
    back = np.stack([-0.2 * np.cos(t), -0.2 - 0.07 * np.sin(t), 0.62 + 0.3 * np.sin(t)], -1)
    hoop = np.concatenate([[(-0.21, -0.24, 0)], back, [(0.21, -0.24, 0)]])
    inner = np.stack([-0.11 * np.cos(t), -0.2 - 0.05 * np.sin(t), 0.6 + 0.2 * np.sin(t)], -1)
    inner = np.concatenate([[(-0.11, -0.19, 0.46)], inner, [(0.11, -0.19, 0.46)]])
    front = np.array([(-0.2, 0.24, 0), (-0.19, 0.2, 0.44), (0.19, 0.2, 0.44), (0.2, 0.24, 0)])
    rim = np.array([(-0.2, -0.2, 0.44), (-0.2, 0.2, 0.44), (0.2, 0.2, 0.44), (0.2, -0.2, 0.44), (-0.2, -0.2, 0.44)])
    cross = [np.array([(s * 0.2, -0.22, 0.2), (-s * 0.2, 0.22, 0.2)]) for s in (-1, 1)]
    curve(chair, "Chair frame", [hoop, inner, front, rim, *cross], 0.009, materials["iron"], 2)
    slat = place(chair, "Chair seat", box((-0.21, -0.2, 0.45), (0.21, -0.145, 0.465)), materials["oak"], repeat=0.5)
    bevel(slat, 0.004)
    array(slat, 6, (0, 0.069, 0))
    return chair


def build_fountain(collection: bpy.types.Collection, materials: Materials, x: float, y: float) -> None:
    """Octagonal basin of glazed tiles with a stone bowl in its middle."""
    angles = np.pi / 8 + np.arange(9) * np.pi / 4
    corners = np.stack([x + 0.86 * np.cos(angles), y + 0.86 * np.sin(angles), 0 * angles], -1)  # (9, 3)
    sides = [sheet(np.stack([corners[k : k + 2], corners[k : k + 2] + (0, 0, 0.42)])) for k in range(8)]
    place(collection, "Basin tiles", join(sides).repeated(3, 2), materials["glaze"])
    rim = lathe([(0.66, 0.1), (0.66, 0.42), (0.66, 0.49), (0.92, 0.49), (0.92, 0.42), (0.86, 0.42)][::-1], 8)
    stone = place(collection, "Basin rim", rim.turned(np.pi / 8).moved((x, y, 0)), materials["stone"])
    bevel(stone, 0.015, 3)
    water = lathe([(0.68, 0.36), (0.02, 0.36)], 8).turned(np.pi / 8).moved((x, y, 0))
    place(collection, "Water", water, materials["water"])
    foot = [
        (0.17, 0.3), (0.17, 0.4), (0.1, 0.46), (0.075, 0.6), (0.09, 0.75), (0.07, 0.86), (0.12, 0.92), (0.36, 1.02),
        (0.42, 1.08), (0.4, 1.09), (0.3, 1.05), (0.06, 1.03), (0.05, 1.2), (0.08, 1.26), (0.05, 1.33), (0.005, 1.37),
    ]  # fmt: skip
    place(collection, "Fountain", lathe(foot, 36).moved((x, y, 0)), materials["stone"], smooth=True)


def build_door(collection: bpy.types.Collection, materials: Materials) -> None:
    """Blue plank door in the back wall's arched opening."""
    plank = place(collection, "Door planks", box((-0.75, 0, 0), (-0.6, 0.05, 2.42)), materials["door"], repeat=0.8)
    plank.location = (0, INSIDE + 0.14, PLINTH)
    bevel(plank, 0.01)
    array(plank, 10, (0.15, 0, 0))
    bands = [box((-0.7, INSIDE + 0.115, z), (0.7, INSIDE + 0.14, z + 0.05)) for z in (0.8, 1.5, 2.2)]
    place(collection, "Door bands", join(bands), materials["iron"])


def build_sign(collection: bpy.types.Collection, materials: Materials) -> None:
    """Sign over the arches: a board, gilded letters (a text object), and scrolls at its ends."""
    y = ARCADE_Y - 0.07
    board = place(collection, "Sign board", box((-1.05, y, 3.72), (1.05, y + 0.05, 4.16)), materials["sign"])
    bevel(board, 0.02, 3)
    text = bpy.data.curves.new("Sign text", "FONT")
    text.body, text.size, text.align_x, text.align_y = "OSTERIA", 0.34, "CENTER", "CENTER"
    text.resolution_u = 4
    text.extrude, text.bevel_depth, text.space_character = 0.012, 0.004, 1.12
    text.materials.append(materials["gold"])
    item = add_object(collection, "Sign text", text)
    item.location, item.rotation_euler = (0, y - 0.014, 3.94), (np.pi / 2, 0, 0)
    frame = np.array([(-1, 3.76), (1, 3.76), (1, 4.12), (-1, 4.12), (-1, 3.76)])
    path = np.column_stack([frame[:, 0], np.full(5, y - 0.006), frame[:, 1]])
    place(collection, "Sign frame", tube(path, 0.008, 6), materials["gold"])
