# SPDX-License-Identifier: GPL-3.0-or-later
"""Voxel object, which shows the voxels of one level in the scene: its points, their shape, their colour."""

from .voxel_object import CUBES, NAME, POINTS, show

__all__ = ["CUBES", "NAME", "POINTS", "show"]
