# SPDX-License-Identifier: GPL-3.0-or-later
"""Scene reader, from a Blender scene to triangles with materials: files, objects, meshes, materials, images."""

from .files import open_scene
from .read import read_scene
from .scene_mesh import SceneMesh

__all__ = ["SceneMesh", "open_scene", "read_scene"]
