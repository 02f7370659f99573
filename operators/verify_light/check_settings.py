# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of `patchnet verify-light`: what is compared with what."""

from __future__ import annotations

from dataclasses import dataclass

from ...patchnet_addon.runtime import bounds
from ...patchnet_addon.runtime.errors import SettingError
from ..schema.table import GLOSS_OFF
from ..settings.job_settings import JobSettings


@dataclass(frozen=True)
class CheckSettings:
    """Settings of a light check.

    job: how the octree is made: depth, light, samples, texels, size and cameras; its `out` takes the results.
    viewpoints: so many cameras are placed in the free space of the scene; 0 takes the job's cameras.
    render_samples: paths per pixel of the Cycles reference, in two halves of different seeds. rays: per pixel side, of
    the octree's picture. difference: luminance at the ends of the pictures' legend. whole_voxels: the same octree
    without the boxes in its finest voxels is compared, too.
    """

    job: JobSettings
    viewpoints: int = 0
    render_samples: int = 256
    rays: int = int(bounds.RAYS.high)
    difference: float = 0.2
    whole_voxels: bool = False

    @property
    def compares_all_light(self) -> bool:
        """Return whether the render has all light: where gloss is baked; else it has diffuse light and emission."""
        return self.job.light.is_baked and self.job.light.gloss != GLOSS_OFF

    def __post_init__(self) -> None:
        if not self.job.surface.has_given_depth:
            raise SettingError("A light check needs a depth: give one")
        bounds.RENDER_SAMPLES.check(self.render_samples)
        bounds.RAYS.check(self.rays)
        bounds.DIFFERENCE.check(self.difference)
