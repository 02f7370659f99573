# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluation of refinement strategies over camera tracks of scenes, without Blender (methods 5)."""
