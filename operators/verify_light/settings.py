# SPDX-License-Identifier: GPL-3.0-or-later
"""What is compared with what."""

from __future__ import annotations

from dataclasses import dataclass

from ...patchnet_addon.errors import SettingError
from ...patchnet_addon.tracing.supersample import MAX_SAMPLES
from ..job.settings import JobSettings


@dataclass(frozen=True)
class CheckSettings:
    """Settings of a comparison.

    job: how the octree is made: depth, light, samples, texels, size and cameras; its `out` takes the results.
    viewpoints: so many cameras are placed in the free space of the scene; 0 takes the job's cameras.
    render_samples: paths per pixel of the Cycles reference, in two halves of different seeds. rays: per pixel side, of
    the octree's picture. difference: luminance at the ends of the pictures' legend.
    """

    job: JobSettings
    viewpoints: int = 0
    render_samples: int = 256
    rays: int = MAX_SAMPLES
    difference: float = 0.2

    def __post_init__(self) -> None:
        if self.job.depth is None and self.job.voxel_world is None:
            raise SettingError("A comparison needs a depth: give one")
        if self.render_samples < 2:
            raise SettingError(f"{self.render_samples} samples per pixel are too few: choose at least 2")
        if not 1 <= self.rays <= MAX_SAMPLES:
            raise SettingError(f"{self.rays} rays per pixel side are outside 1 to {MAX_SAMPLES}")
        if not self.difference > 0:
            raise SettingError(f"The difference's maximum {self.difference} must be a positive number")
