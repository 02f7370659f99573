# SPDX-License-Identifier: GPL-3.0-or-later
"""Build the courtyard scene and save it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import bpy
import numpy as np

from ...patchnet_addon.runtime.interrupt import interrupts_wait
from . import furniture, ironwork, masonry, plants, roofs
from .cameras import build_cameras
from .lighting import build_light
from .materials import make_materials, make_pictures


def courtyard_pictures(seed: int = 1) -> dict[str, np.ndarray]:
    """Textures for `build_courtyard`, most of its time; without Blender's data, so that a thread can make them."""
    return make_pictures(_streams(seed)[0])


def _streams(seed: int) -> list[np.random.Generator]:
    return np.random.default_rng(seed).spawn(8)


def build_courtyard(scene: bpy.types.Scene, seed: int = 1, pictures: Mapping[str, np.ndarray] | None = None) -> None:
    """Build the courtyard into a scene: about 12 m wide, every random choice from `seed`.

    pictures: its textures, where they are there.

    Fence, gate and grilles are thinner than a distant pixel, a white cloth lies 7 mm above a dark table, leaves are cut
    by alpha: what a coarse view gets wrong. Sets the scene's world, camera and render settings.
    """
    streams = iter(_streams(seed)[1:])
    materials = make_materials(pictures or courtyard_pictures(seed))
    parts = {name: _part(scene, name) for name in ("Masonry", "Ironwork", "Furniture", "Plants", "Light", "Cameras")}
    stone, iron, furnishing, green = (parts[name] for name in ("Masonry", "Ironwork", "Furniture", "Plants"))
    masonry.build_floor(stone, materials, next(streams))
    masonry.build_steps(stone, materials)
    masonry.build_walls(stone, materials)
    masonry.build_arcade(stone, materials)
    roofs.build_roofs(stone, materials, next(streams))
    ironwork.build_fence(iron, materials)
    ironwork.build_gate(iron, materials)
    ironwork.build_grilles(iron, materials)
    ironwork.build_lantern(iron, materials)
    furniture.build_table(furnishing, materials, next(streams))
    furniture.build_fountain(furnishing, materials, 2.1, -0.55)
    furniture.build_door(furnishing, materials)
    furniture.build_sign(furnishing, materials)
    plants.build_pots(green, materials, next(streams))
    plants.build_tree(green, materials, next(streams), 4.05, -1.3)
    plants.build_bougainvillea(green, materials, next(streams))
    build_light(scene, parts["Light"])
    build_cameras(scene, parts["Cameras"])
    _render_settings(scene)


def save_demo_scene(path: Path, seed: int = 1) -> None:
    """Build the courtyard in an empty file and save it with its images packed; replaces whatever is open."""
    bpy.ops.wm.read_homefile(use_empty=True)
    build_courtyard(bpy.context.scene, seed)
    path.parent.mkdir(parents=True, exist_ok=True)
    with interrupts_wait():
        bpy.ops.wm.save_as_mainfile(filepath=str(path.resolve()), compress=True)


def _part(scene: bpy.types.Scene, name: str) -> bpy.types.Collection:
    collection = bpy.data.collections.new(name)
    scene.collection.children.link(collection)
    return collection


def _render_settings(scene: bpy.types.Scene) -> None:
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 64
    scene.cycles.use_denoising = True
    scene.view_settings.view_transform = "Standard"
    scene.unit_settings.system = "METRIC"
