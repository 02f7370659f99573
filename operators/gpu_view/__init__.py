# SPDX-License-Identifier: GPL-3.0-or-later
"""Octree and decoder on the graphics card: packing, shaders, passes (docs/gpu.md)."""
