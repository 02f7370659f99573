# SPDX-License-Identifier: GPL-3.0-or-later
"""Light verification: an octree against a Cycles render from the same cameras (docs/lab/light.md)."""

from .check import CameraCheck, CheckSettings, LightCheck, verify_light

__all__ = ["CameraCheck", "CheckSettings", "LightCheck", "verify_light"]
