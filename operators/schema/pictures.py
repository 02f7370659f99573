# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of a view: their names, and the ends of their legends."""

from __future__ import annotations

ERROR_MAXIMUM = 0.5  # luminance error at the end of the error picture's legend

# Each picture that is a file and a Blender image, in the order in which a user would look at them.
PICTURES = ("preview", "heatmap", "overlay", "refined", "reference", "error")
PRIORITY_NAME = "priority.exr"
