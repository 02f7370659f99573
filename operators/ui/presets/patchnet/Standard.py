# SPDX-License-Identifier: GPL-3.0-or-later
"""Preset of the settings of a new scene."""

import bpy

settings = bpy.context.scene.patchnet
settings.resolution = "AUTO"
settings.depth = 9
settings.track = False
settings.light = "cycles"
settings.noise_threshold = 0.03
settings.max_samples = 32
settings.color = True
settings.size = (192, 0)
settings.strategy = "patchnet-plus"
settings.unrefined = "preview"
settings.budget = 0.3
settings.refined_samples = 64.0
settings.spp = 0.0
