# SPDX-License-Identifier: GPL-3.0-or-later
"""Scene reader, from a Blender scene to triangles with materials: files, objects, meshes, materials, images."""
