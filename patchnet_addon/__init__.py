# SPDX-License-Identifier: GPL-3.0-or-later
"""Engine: pure computation on arrays, without Blender."""
