# SPDX-License-Identifier: GPL-3.0-or-later
"""Everything that touches Blender: operators, panel, scene to arrays, baking, results as images."""
