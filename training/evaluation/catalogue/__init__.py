# SPDX-License-Identifier: GPL-3.0-or-later
"""Catalogue of the scenes of an evaluation, each a recipe in a file of its own."""

from __future__ import annotations

from ....patchnet_addon.runtime.errors import SettingError
from ..scene import Scene
from . import (
    clinic,
    courtyard,
    furnished_garden,
    furnished_room,
    san_miguel,
    san_miguel_bare,
    shuttle,
    sponza,
    sports_car,
    station,
)

_MODULES = (
    san_miguel_bare, san_miguel, sponza, clinic, shuttle, station, sports_car, courtyard, furnished_room,
    furnished_garden,
)  # fmt: skip
SCENES: dict[str, Scene] = {module.SCENE.name: module.SCENE for module in _MODULES}


def scene_named(name: str) -> Scene:
    """Find a scene; raises SettingError for a name that is not in the catalogue."""
    if name not in SCENES:
        raise SettingError(f"There is no scene {name!r}: choose one of {', '.join(SCENES)}")
    return SCENES[name]
