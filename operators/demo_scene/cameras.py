# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras of the courtyard: far and middle at distances that look-ahead needs at 192 pixels, and a close-up."""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Vector

from .geometry import add_object

FIELD_OF_VIEW = float(np.radians(50.0))
# Name: (position, target) in metres.
VIEWS = {
    "Far": ((3.4, -15.4, 7.3), (0.1, 0.4, 2.35)),
    "Middle": ((1.6, -10.85, 3.6), (-0.4, 0.6, 1.95)),
    "Close": ((0.15, -5.3, 2.0), (-1.6, -0.6, 1.0)),
}


def build_cameras(scene: bpy.types.Scene, collection: bpy.types.Collection) -> None:
    """Add the views for square pictures; Middle becomes the scene's camera."""
    for name, (position, target) in VIEWS.items():
        data = bpy.data.cameras.new(name)
        data.sensor_fit, data.angle = "AUTO", FIELD_OF_VIEW
        item = add_object(collection, name, data)
        item.location = position
        item.rotation_euler = (Vector(position) - Vector(target)).to_track_quat("Z", "Y").to_euler()
        if name == "Middle":
            scene.camera = item
    render = scene.render
    render.resolution_x = render.resolution_y = 512
    render.resolution_percentage = 100
