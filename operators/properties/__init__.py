# SPDX-License-Identifier: GPL-3.0-or-later
"""Properties of every setting, declared once: for the scene's settings and for the operators that use them.

A class for each group of settings, to be mixed into operators and into the group of the scene.
"""

from .job import absolute_path, cycles_settings, is_given, job_settings, scene_settings, setting
from .scene import PatchNetSettings, register, unregister
from .stages import (
    AnimationProperties,
    CameraProperties,
    CodesProperties,
    CyclesRefineProperties,
    DisplayProperties,
    FrameProperties,
    JobProperties,
    LevelProperties,
    LightProperties,
    ViewProperties,
    VoxelizeProperties,
)

__all__ = [
    "AnimationProperties",
    "CameraProperties",
    "CodesProperties",
    "CyclesRefineProperties",
    "DisplayProperties",
    "FrameProperties",
    "JobProperties",
    "LevelProperties",
    "LightProperties",
    "PatchNetSettings",
    "ViewProperties",
    "VoxelizeProperties",
    "absolute_path",
    "cycles_settings",
    "is_given",
    "job_settings",
    "register",
    "scene_settings",
    "setting",
    "unregister",
]
