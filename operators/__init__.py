# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender integration: operators, panel, scene to arrays, baking, results as images."""
