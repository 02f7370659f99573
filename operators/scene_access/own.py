# SPDX-License-Identifier: GPL-3.0-or-later
"""Data-blocks that operators leave in a file on purpose: pictures, and the object that shows voxels.

They are no part of the scene that is read, lit and watched for changes."""

from __future__ import annotations

import bpy

OWNER = "patchnet_result"  # custom property that marks a data-block as ours to overwrite


def is_own(item: bpy.types.ID) -> bool:
    """Return whether an operator of ours made this data-block, original or evaluated, as a result."""
    return OWNER in item
