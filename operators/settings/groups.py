# SPDX-License-Identifier: GPL-3.0-or-later
"""Groups of a job's settings: surface, light, network, view, compute; each checks its values when it is made."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from ...patchnet_addon.image.colormaps import COLORMAPS
from ...patchnet_addon.network.devices import CUDA, read_device
from ...patchnet_addon.octree.grid import Grid
from ...patchnet_addon.runtime.errors import SettingError
from ...patchnet_addon.runtime.frames import frame_range
from ...patchnet_addon.sampling.predicted import UNREFINED
from ...patchnet_addon.sampling.registry import strategy
from ...patchnet_addon.sampling.strategy import REFERENCE
from ...patchnet_addon.surface.mesh import MeshSource
from ..importance.painted import Importance
from ..scene_access.devices import DEVICES
from ..schema.setting import Kind
from ..schema.table import CYCLES, GPU, SIX_SIDES, TABLE, TWO_LIGHTS, VISIBLE
from .cycles_settings import CyclesSettings

Bounds = tuple[tuple[float, float, float], tuple[float, float, float]]
NETWORK_DEVICE = f"The network's device ({TABLE['network_device'].label})"
_FLAT = "flat name"  # of a field whose own name is ambiguous among all settings


@dataclass(frozen=True)
class SurfaceSettings:
    """Settings of the voxelized surface and its resolution.

    scope: SELECTED objects, or VISIBLE for all that render.
    depth: of the octree. voxel_size_world: leaf side instead of a depth. Without both, leaves are as deep as cameras
    need (methods 4.1b). track: the cameras count at all frames of a track, not only at the current one. track_frames:
    first and last of them, (0, 0) for those of the scene. bounds: lower
    and upper corner of the octree's cube in world units; None takes the surface's own. shape: where rays that reach
    the finest voxels end: "exact" on the surface, "boxes" around it, "whole" voxels (methods 4.1d, 7.2k).
    """

    scope: str = VISIBLE
    depth: int | None = None
    voxel_size_world: float | None = None
    track: bool = False
    track_frames: tuple[int, int] = (0, 0)
    bounds: Bounds | None = None
    shape: str = TABLE["shape"].default

    def __post_init__(self) -> None:
        _check_choice("shape", self.shape, [value for value, _, _ in TABLE["shape"].choices])
        if self.depth is not None and self.voxel_size_world is not None:
            raise SettingError("Depth and voxel size are both given: choose one of them")
        if self.track and not self.is_fitted:
            raise SettingError("Only voxels of automatic depth can follow a track: choose that depth, or no track")
        if any(self.track_frames):
            frame_range(*self.track_frames)
        _check_numbers(self)

    @property
    def is_fitted(self) -> bool:
        """Return whether leaves are fitted to the cameras, since neither depth nor voxel size is given."""
        return self.depth is None and self.voxel_size_world is None

    @property
    def fitted_track(self) -> tuple[int, int] | None:
        """First and last frame of the track that leaves are fitted to; None without one."""
        return self.track_frames if self.is_fitted and self.track else None

    def bounds_world(self, source: MeshSource) -> np.ndarray:
        """(2, 3): bounds of the octree's cube."""
        return source.bounds_world if self.bounds is None else np.array(self.bounds, np.float64)

    def given_grid(self, source: MeshSource) -> Grid:
        """Grid of the given depth or voxel size."""
        bounds_world = self.bounds_world(source)
        if self.depth is not None:
            return Grid.around(bounds_world, self.depth)
        assert self.voxel_size_world is not None
        return Grid.with_voxel_size(bounds_world, self.voxel_size_world)


@dataclass(frozen=True)
class LightSettings:
    """Settings of the light in the voxels.

    kind: "cycles" bakes global illumination, "two-lights" is methods 7.3.
    noise_threshold, max_samples: surfels get paths until pixels are less noisy, at most so many (methods 7.2e).
    cells: surface with fine light, "seen" by cameras or "everywhere" (methods 7.2g).
    exposure: factor on luminance; None chooses it by the surface (methods 7.1).
    gloss: which reflections are baked, seen from where: auto, off, above, camera.
    denoise: average light cells with their neighbours, within noise (methods 7.2h).
    color: keep colour beside luminance, for pictures and exports; two bytes a node (methods 7.2d).
    sides: whether voxels show light by direction, "six", or one mean (methods 7.2i).
    daylight: whether sun and sky are added for the bake; None adds them to a scene without light.
    from_camera: whether gloss is seen from the active camera; None: by `gloss` and the job's cameras.
    """

    kind: str = field(default=TABLE["light"].default, metadata={_FLAT: "light"})
    noise_threshold: float = TABLE["noise_threshold"].default
    max_samples: int = TABLE["max_samples"].default
    cells: str = TABLE["cells"].default
    exposure: float | None = None
    gloss: str = TABLE["gloss"].default
    denoise: bool = TABLE["denoise"].default
    color: bool = TABLE["color"].default
    sides: str = TABLE["sides"].default
    daylight: bool | None = None
    from_camera: bool | None = None

    def __post_init__(self) -> None:
        _check_numbers(self)
        if self.kind not in (CYCLES, TWO_LIGHTS):
            raise SettingError(f"There is no light {self.kind!r}: choose {CYCLES} or {TWO_LIGHTS}")
        for name in ("gloss", "sides", "cells"):
            _check_choice(name, getattr(self, name), [value for value, _, _ in TABLE[name].choices])

    @property
    def has_sides(self) -> bool:
        """Return whether voxels show light by direction."""
        return self.sides == SIX_SIDES

    @property
    def is_baked(self) -> bool:
        """Return whether Cycles computes the light."""
        return self.kind == CYCLES


@dataclass(frozen=True)
class NetworkSettings:
    """Settings of the look-ahead network. weights: file; None for the shipped ones."""

    weights: Path | None = None


def samples_side(samples: float) -> int:
    """Rays per pixel side of the square number nearest to `samples`."""
    return max(1, round(math.sqrt(samples)))


@dataclass(frozen=True)
class ViewSettings:
    """Settings of the views: cameras, order of refinement, and display.

    cameras: names, or ("all",), or ("auto",); empty for the scene's active camera.
    size: pictures in pixels; a height of 0 follows the render aspect, (0, 0) is the render resolution.
    unrefined: picture of unrefined pixels, "preview" or "predicted" (methods 3.12b).
    budget: share of active pixels to refine. refined_samples: mean samples of these, spread by priority. spp: mean
    samples per active pixel instead (methods 7.25b); None refines the share. reference: whether whole jobs measure the
    errors of all strategies against 32x32 rays in every pixel. background: of pictures, where no surface is.
    heatmap_maximum: None takes the strategy's own.
    render_samples: of every pixel in renders of the engine and its viewport; None refines by priority there, too.
    importance: painted importance; None if all pixels matter alike. cycles: render of the worst pixels by Cycles over
    the preview; None for none.
    """

    cameras: tuple[str, ...] = ()
    size: tuple[int, int] = TABLE["size"].default
    budget: float = TABLE["budget"].default
    refined_samples: float = TABLE["refined_samples"].default
    spp: float | None = None
    render_samples: float | None = TABLE["render_samples"].default
    reference: bool = TABLE["reference"].default
    strategy: str = TABLE["strategy"].default
    unrefined: str = TABLE["unrefined"].default
    background: str = TABLE["background"].default
    heatmap_maximum: float | None = None
    colormap: str = COLORMAPS[0]
    importance: Importance | None = None
    cycles: CyclesSettings | None = None

    def __post_init__(self) -> None:
        strategy(self.strategy)
        _check_numbers(self)
        _check_choice("background", self.background, [value for value, _, _ in TABLE["background"].choices])
        _check_choice("color map", self.colormap, COLORMAPS)
        _check_choice("picture of unrefined pixels", self.unrefined, UNREFINED)

    @property
    def has_reference(self) -> bool:
        """Return whether a job's views have a reference: by the setting, or since the strategy ranks by it."""
        return self.reference or REFERENCE in strategy(self.strategy).needs

    @property
    def budget_text(self) -> str:
        """Budget in words, after "refined with"."""
        return f"a budget of {self.budget:.0%}" if self.spp is None else f"{self.spp:g} samples per pixel"


@dataclass(frozen=True)
class ComputeSettings:
    """Settings of devices and memory. memory_bytes: limit for the octree while it is built; None for all free memory.
    It bounds the depth, so it is in keys. device: of the bake. network_device: of encoding, AUTO, CPU or GPU, or as
    torch names one, cuda:1. Devices change results by rounding alone, and count for no frame's key.
    """

    memory_bytes: int | None = None
    device: str = field(default=TABLE["device"].default, repr=False)
    network_device: str = field(default=TABLE["network_device"].default, repr=False)

    def __post_init__(self) -> None:
        _check_numbers(self)
        _check_choice("device", self.device, DEVICES)
        read_device(self.torch_device, NETWORK_DEVICE)

    @property
    def torch_device(self) -> str:
        """Device that the network runs on, as torch names it: auto, cpu, cuda or cuda:N."""
        return CUDA if self.network_device == GPU else self.network_device.lower()


def fields_by_flat_name(group: Any) -> dict[str, str]:
    """Names of a group's fields, by the names that they have among all settings."""
    return {item.metadata.get(_FLAT, item.name): item.name for item in fields(group)}


def _check_choice(what: str, value: str, known: Iterable[str]) -> None:
    if value not in known:
        raise SettingError(f"There is no {what} {value!r}: choose one of {', '.join(known)}")


def _check_numbers(group: Any) -> None:
    """Raise SettingError for a number outside the table's bounds; None is automatic."""
    names = fields_by_flat_name(group)
    for row in TABLE.values():
        if row.bounds is None or row.job_field not in names:
            continue
        value = getattr(group, names[row.job_field])
        if value is None:
            continue
        if row.name == "memory":
            value = value / 2**30
        for number in value if row.kind is Kind.PAIR else (value,):
            row.bounds.check(number)
