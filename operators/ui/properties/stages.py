# SPDX-License-Identifier: GPL-3.0-or-later
"""Properties of the stages of a job, which scenes and operators mix in; declared in the table of settings."""

from __future__ import annotations

from ...schema.table import CAMERAS, CODES, IMPORTANCE, LIGHT, OCTREE, OUTPUT, VIEW
from .shapes import properties_of


class VoxelizeProperties:
    """Octree: what is voxelized, and how finely."""

    __annotations__ = properties_of(OCTREE)


class LightProperties:
    """Light: where luminance comes from."""

    __annotations__ = properties_of(LIGHT)


class CodesProperties:
    """Network that looks ahead."""

    __annotations__ = properties_of(CODES)


class CameraProperties:
    """Cameras: whose pictures are made, and how large."""

    __annotations__ = properties_of(CAMERAS)


class ImportanceProperties:
    """Importance: what matters to the user, painted."""

    __annotations__ = properties_of(IMPORTANCE)


class ViewProperties(ImportanceProperties):
    """View: what is refined first, and how it is shown."""

    __annotations__ = properties_of(VIEW)


class OutputProperties:
    """Output: where files go."""

    __annotations__ = properties_of(OUTPUT)


class JobProperties(
    VoxelizeProperties, LightProperties, CodesProperties, CameraProperties, ViewProperties, OutputProperties
):
    """All settings of a job."""
