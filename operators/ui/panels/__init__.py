# SPDX-License-Identifier: GPL-3.0-or-later
"""Sidebar tab PatchNet, a file for each of its panels."""

from . import compare, cycles_refine, export, light, main, network, octree, preview, statistics

_ORDER = (main, octree, light, network, preview, compare, cycles_refine, export, statistics)
CLASSES = tuple(item for module in _ORDER for item in module.CLASSES)
