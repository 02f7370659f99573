# SPDX-License-Identifier: GPL-3.0-or-later
"""Reader of Blender scenes: files, objects, meshes, materials and images become triangles with materials."""
