# SPDX-License-Identifier: GPL-3.0-or-later
"""Properties of all settings, declared once for the scene and for operators.

Each group of settings is a class to mix into operators and into the property group of the scene.
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
