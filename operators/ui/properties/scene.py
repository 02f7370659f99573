# SPDX-License-Identifier: GPL-3.0-or-later
"""Properties of the scene: all settings as it remembers them."""

from __future__ import annotations

import bpy
from bpy.props import PointerProperty

from .cycles_refine import CyclesRefineProperties
from .derived import DerivedProperties
from .display import DisplayProperties
from .output import AnimationProperties
from .stages import JobProperties


class PatchNetSettings(
    JobProperties,
    DerivedProperties,
    AnimationProperties,
    DisplayProperties,
    CyclesRefineProperties,
    bpy.types.PropertyGroup,
):
    """Settings that a scene remembers; operators use them for whatever is not given to themselves."""


def register() -> None:
    """Give scenes their settings."""
    bpy.utils.register_class(PatchNetSettings)
    bpy.types.Scene.patchnet = PointerProperty(type=PatchNetSettings)


def unregister() -> None:
    """Take the settings away."""
    del bpy.types.Scene.patchnet
    bpy.utils.unregister_class(PatchNetSettings)
