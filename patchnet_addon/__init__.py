# SPDX-License-Identifier: GPL-3.0-or-later
"""The engine: pure computation on arrays, without Blender."""
