# SPDX-License-Identifier: GPL-3.0-or-later
"""Preset of the paper's settings: depth 10, two lights without shadows, 130 x 130 pixels, its own score."""

import bpy

settings = bpy.context.scene.patchnet
settings.resolution = "DEPTH"
settings.depth = 10
settings.light = "two-lights"
settings.samples = 4
settings.texel_voxels = 2.0
settings.color = False
settings.size = (130, 130)
settings.strategy = "patchnet"
settings.unrefined = "preview"
settings.budget = 0.3
settings.refined_samples = 1024.0
settings.spp = 0.0
