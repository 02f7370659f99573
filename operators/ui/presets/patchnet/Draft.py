# SPDX-License-Identifier: GPL-3.0-or-later
"""Preset for a first look within seconds: small pictures, coarse voxels, few paths."""

import bpy

settings = bpy.context.scene.patchnet
settings.resolution = "DEPTH"
settings.depth = 7
settings.light = "cycles"
settings.noise_threshold = 0.05
settings.max_samples = 8
settings.color = True
settings.size = (96, 0)
settings.strategy = "patchnet-plus-1"
settings.unrefined = "preview"
settings.budget = 0.3
settings.refined_samples = 64.0
settings.spp = 0.0
