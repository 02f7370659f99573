# SPDX-License-Identifier: GPL-3.0-or-later
"""Engine process: a second Python process that computes for Blender, and what both share."""
