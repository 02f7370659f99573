# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of a job as one value, checked when it is made."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ...patchnet_addon.image.colormaps import COLORMAPS
from ...patchnet_addon.runtime.errors import SettingError
from ...patchnet_addon.sampling.registry import strategy
from ...patchnet_addon.surface.mesh import MeshSource
from ..importance.painted import Importance
from ..scene_access.devices import DEVICES
from ..schema.setting import Kind
from ..schema.table import CYCLES, TABLE, TWO_LIGHTS, VISIBLE
from .cycles_settings import CyclesSettings

Bounds = tuple[tuple[float, float, float], tuple[float, float, float]]


@dataclass(frozen=True)
class JobSettings:
    """Settings of a job on a scene.

    scope: SELECTED objects or all VISIBLE renderable ones.
    depth: of the octree; None chooses it by the cameras (methods 4.1b). voxel_size_world: leaf side instead of a depth.
    fit: leaves only as deep as the cameras need them, coarse elsewhere, instead of one depth. track: the cameras are
    looked through at all frames of the scene for that, not only at the present one.
    memory_bytes: what the octree may take while it is built; None for all that is free.
    light: "cycles" bakes global illumination with `samples` per texel, "two-lights" is methods 7.3.
    exposure: factor on luminance; None chooses it by the surface (methods 7.1).
    both_sides: of opaque sheets, voxels hold the mean of both sides; else the light of the side that normals show.
    color: keep colour beside luminance, for pictures and exports; two bytes a node (methods 7.2d).
    texel_voxels: side of a baked texel in leaf voxels; 2 gives each voxel that stops a ray with look-ahead 4 texels.
    cameras: names, or ("all",), or ("auto",); empty for the scene's active camera.
    size: pictures in pixels; a height of 0 follows the render aspect, (0, 0) is the render resolution.
    budget: share of active pixels to refine. heatmap_maximum: None takes the strategy's own.
    weights: file; None for the shipped ones. out: folder for files; None writes none.
    bounds: lower and upper corner, in world units, that the octree's cube is put around; None takes the surface's own.
    importance: what was painted to matter; None where all pixels matter alike.
    device: of the bake; encoder_device: of the network where torch is there. torch_python: another Python that has
    torch. They decide which device computes, and not what: they count for no frame's key.
    daylight: whether sun and sky are added for the bake; None adds them to a scene without light.
    cycles: how Cycles renders the worst regions over the preview; None renders none.
    """

    scope: str = VISIBLE
    depth: int | None = None
    voxel_size_world: float | None = None
    fit: bool = False
    track: bool = False
    memory_bytes: int | None = None
    light: str = TABLE["light"].default
    samples: int = TABLE["samples"].default
    exposure: float | None = None
    both_sides: bool = TABLE["both_sides"].default
    color: bool = TABLE["color"].default
    texel_voxels: float = TABLE["texel_voxels"].default
    cameras: tuple[str, ...] = ()
    size: tuple[int, int] = TABLE["size"].default
    budget: float = TABLE["budget"].default
    strategy: str = TABLE["strategy"].default
    heatmap_maximum: float | None = None
    colormap: str = COLORMAPS[0]
    weights: Path | None = None
    out: Path | None = None
    bounds: Bounds | None = None
    daylight: bool | None = None
    cycles: CyclesSettings | None = None
    importance: Importance | None = None
    device: str = field(default=TABLE["device"].default, repr=False)
    encoder_device: str = field(default=TABLE["encoder_device"].default, repr=False)
    torch_python: Path | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        strategy(self.strategy)
        if self.depth is not None and self.voxel_size_world is not None:
            raise SettingError("Depth and voxel size are both given: choose one of them")
        if self.fit and (self.depth is not None or self.voxel_size_world is not None):
            raise SettingError("Leaves that fit the cameras have no one depth or voxel size: choose one of them")
        if self.track and not self.fit:
            raise SettingError("Only leaves that fit the cameras can follow a track: choose fit, or no track")
        self._check_numbers()
        if self.light not in (CYCLES, TWO_LIGHTS):
            raise SettingError(f"There is no light {self.light!r}: choose {CYCLES} or {TWO_LIGHTS}")
        if self.cycles is not None and self.light != CYCLES:
            raise SettingError(f"Regions by Cycles need voxels in Cycles' light, not {self.light}: choose {CYCLES}")
        if self.colormap not in COLORMAPS:
            raise SettingError(f"There is no colour map {self.colormap!r}: choose one of {', '.join(COLORMAPS)}")
        for name in (self.device, self.encoder_device):
            if name not in DEVICES:
                raise SettingError(f"There is no device {name!r}: choose one of {', '.join(DEVICES)}")

    def _check_numbers(self) -> None:
        """Raises SettingError for a number outside the table's bounds; None is automatic."""
        for row in TABLE.values():
            if row.bounds is None or (value := getattr(self, row.job_field)) is None:
                continue
            if row.name == "memory":
                value = value / 2**30
            for number in value if row.kind is Kind.PAIR else (value,):
                row.bounds.check(number)

    def bounds_world(self, source: MeshSource) -> np.ndarray:
        """(2, 3): what the octree's cube is put around."""
        return source.bounds_world if self.bounds is None else np.array(self.bounds, np.float64)
