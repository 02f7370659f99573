# SPDX-License-Identifier: GPL-3.0-or-later
"""Groups of a job's settings, whose fields declare them: surface, light, network, views. Each checks its values.

All else is derived from the fields, in their order: properties of scenes and operators (`properties/`), panels (`ui/`),
arguments of commands (`commands/shared/job_arguments.py`), what makes a step stale, keys, and records of the settings
in octree files and reports (`job_settings.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...patchnet_addon.image.colormaps import COLORMAPS
from ...patchnet_addon.network.devices import CUDA, read_device
from ...patchnet_addon.octree.grid import Grid
from ...patchnet_addon.runtime import bounds
from ...patchnet_addon.runtime.errors import SettingError
from ...patchnet_addon.runtime.frames import frame_range
from ...patchnet_addon.sampling.adaptive import PictureSettings
from ...patchnet_addon.sampling.predicted import PREDICTED, PREVIEW
from ...patchnet_addon.sampling.registry import DEFAULT, STRATEGIES, strategy
from ...patchnet_addon.sampling.strategy import REFERENCE
from ...patchnet_addon.surface.mesh import MeshSource
from ...patchnet_addon.tracing.pixel_filter import PixelFilter
from ..importance.painted import Importance
from ..schema.setting import Effect, Kind, Place, Setting, check_values
from ..schema.values import (
    ALL_CELLS,
    AUTO,
    BLACK_BACKGROUND,
    BOX_SHAPE,
    CAMERAS,
    CODES,
    CPU,
    CYCLES,
    DEPTH,
    EXACT_SHAPE,
    GLOSS_ABOVE,
    GLOSS_AUTO,
    GLOSS_CAMERA,
    GLOSS_OFF,
    GPU,
    IMAGE,
    IMPORTANCE,
    LIGHT,
    NOTHING,
    OCTREE,
    ONE_SIDE,
    RENDERS,
    SEEN_CELLS,
    SELECTED,
    SIX_SIDES,
    TRANSPARENT,
    TWO_LIGHTS,
    VERTEX_GROUP,
    VIEW,
    VISIBLE,
    VOXEL_SIZE,
    WHOLE_SHAPE,
    WORLD,
)
from .cycles_settings import CyclesSettings

Bounds = tuple[tuple[float, float, float], tuple[float, float, float]]
_NETWORK_DEVICE = "Network Device"
NETWORK_DEVICE = f"The network's device ({_NETWORK_DEVICE})"


def _is_fitted(values: Any) -> bool:
    return bool(values.resolution == AUTO)


_RESOLUTION = Setting(
    "Voxel Detail", "Size of the finest voxels", OCTREE, Kind.CHOICE, AUTO,
    name="resolution", place=Place.FIRST, argument="",
    choices=(
        (AUTO, "Automatic", "Fine voxels where cameras see the surface, coarse ones elsewhere"),
        (DEPTH, "Octree Depth", "Set the number of levels"),
        (VOXEL_SIZE, "Voxel Size", "Set the side of the finest voxels"),
    ),
)  # fmt: skip


@dataclass(frozen=True)
class SurfaceSettings:
    """Settings of the voxelized surface and its resolution.

    Without depth and voxel size, leaves are as deep as cameras need (methods 4.1b). shape: methods 4.1d, 7.2k.
    bounds: lower and upper corner of the octree's cube in world units; None takes the surface's own.
    """

    scope: str = Setting(
        "Objects", "Objects that become voxels", OCTREE, Kind.CHOICE, VISIBLE, shown=AUTO,
        choices=(
            (AUTO, "Automatic", "Selected objects in a window, all visible ones in background"),
            (SELECTED, "Selected", "Selected objects"),
            (VISIBLE, "Visible", "All objects that render, hidden in viewports or not"),
        ),
        place=Place.FIRST, argument="",
    ).as_field()  # fmt: skip
    depth: int | None = Setting(
        "Octree Depth",
        "Levels of the octree; each further one halves the voxels and takes four times the memory",
        OCTREE, Kind.NUMBER, None, bounds.DEPTH, shown=9,
        counts=lambda values: values.resolution == DEPTH, place=Place.FIRST,
        help="octree depth; auto: fine where the cameras look, coarse elsewhere (auto)",
    ).as_field(before=(_RESOLUTION,))  # fmt: skip
    voxel_size_world: float | None = Setting(
        "Voxel Size", "Side of the finest voxels; smaller ones show finer detail and take more memory",
        OCTREE, Kind.NUMBER, None, bounds.VOXEL_SIZE, shown=0.01,
        name="voxel_size", counts=lambda values: values.resolution == VOXEL_SIZE, place=Place.FIRST,
        help="side of the finest voxels in world units, instead of a depth",
        widget={"unit": "LENGTH", "precision": 4},
    ).as_field()  # fmt: skip
    track: bool = Setting(
        "All Frames",
        "Fit the voxels to the cameras at all frames of the scene instead of the current one",
        OCTREE, Kind.SWITCH, False, counts=_is_fitted,
        help="with --depth auto: the cameras at all frames of the scene as saved, or at those from FIRST to LAST",
    ).as_field()  # fmt: skip
    track_frames: tuple[int, int] = Setting(
        "Track",
        "First and last frame that voxels are fitted to with All Frames, whatever is rendered; twice 0: those of the "
        "scene",
        OCTREE, Kind.PAIR, (0, 0), bounds.FRAME, counts=lambda values: _is_fitted(values) and values.track,
        argument="", automatic="Scene's",
    ).as_field()  # fmt: skip
    shape: str = Setting(
        "Surface in Voxels", "Where rays that reach the finest voxels end", OCTREE, Kind.CHOICE, EXACT_SHAPE,
        choices=(
            (EXACT_SHAPE, "Exact", "On the surface itself, whose textures are as sharp as pixels; voxels take twice as "
             "much memory"),
            (BOX_SHAPE, "Boxes", "On the box around the surface in a voxel"),
            (WHOLE_SHAPE, "Whole", "On the voxel"),
        ),
        place=Place.ADVANCED, argument="--surface", help="where rays that reach the finest voxels end",
    ).as_field()  # fmt: skip
    memory: float | None = Setting(
        "Memory (GiB)",
        "Memory limit while the octree is built; a higher one allows smaller voxels, 0 uses all free memory",
        OCTREE, Kind.AUTOMATIC, None, bounds.MEMORY_GIB, effect=Effect.PERHAPS,  # it bounds the depth
        place=Place.ADVANCED, help="memory limit while the octree is built (all free memory)", unit="GIB",
        widget={"soft_max": 64.0, "precision": 1}, automatic="All Free", first=4.0,
    ).as_field()  # fmt: skip
    bounds: Bounds | None = None

    def __post_init__(self) -> None:
        check_values(self)
        if self.depth is not None and self.voxel_size_world is not None:
            raise SettingError("Depth and voxel size are both given: choose one of them")
        if self.track and not self.is_fitted:
            raise SettingError("Only voxels of automatic depth can follow a track: choose that depth, or no track")
        if any(self.track_frames):
            frame_range(*self.track_frames)

    @property
    def resolution(self) -> str:
        """What leaves have their size by: AUTO, DEPTH or VOXEL_SIZE."""
        return DEPTH if self.depth is not None else AUTO if self.voxel_size_world is None else VOXEL_SIZE

    @property
    def is_fitted(self) -> bool:
        """Return whether leaves are fitted to the cameras, since neither depth nor voxel size is given."""
        return _is_fitted(self)

    @property
    def fitted_track(self) -> tuple[int, int] | None:
        """First and last frame of the track that leaves are fitted to; None without one."""
        return self.track_frames if self.is_fitted and self.track else None

    @property
    def memory_bytes(self) -> int | None:
        """Memory limit; None for all free memory."""
        return None if self.memory is None else round(self.memory * 2**30)

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


def _is_baked(values: Any) -> bool:
    return bool(values.light == CYCLES)


@dataclass(frozen=True)
class LightSettings:
    """Settings of the light in the voxels.

    kind: "cycles" bakes global illumination, "two-lights" is methods 7.3.
    noise_threshold, max_samples: methods 7.2e. cells: 7.2g. exposure: 7.1. denoise: 7.2h. color: 7.2d. sides: 7.2i.
    daylight: whether sun and sky are added for the bake; None adds them to a scene without light.
    from_camera: whether gloss is seen from the active camera; None: by `gloss` and the job's cameras.
    """

    kind: str = Setting(
        "Light", "Light that the voxels store", LIGHT, Kind.CHOICE, CYCLES,
        name="light",
        choices=(
            (CYCLES, "Cycles", "Direct and indirect light, emission and textures, baked by Cycles"),
            (TWO_LIGHTS, "Two Lights", "Two opposite lights without shadows, as in the paper, without a bake"),
        ),
        help="light",
    ).as_field()  # fmt: skip
    noise_threshold: float = Setting(
        "Noise Threshold",
        "Noise at which light is no longer refined, as in Cycles' own sampling; lower ones take longer",
        LIGHT, Kind.NUMBER, 0.03, bounds.NOISE_THRESHOLD,
        counts=_is_baked, place=Place.FIRST, help="noise of pixels at which light is no longer refined",
        widget={"precision": 4, "step": 0.1},
    ).as_field()  # fmt: skip
    max_samples: int = Setting(
        "Max Samples",
        "Most paths of each place whose light is baked; more reduce noise and take longer",
        LIGHT, Kind.NUMBER, 32, bounds.SAMPLES,
        counts=_is_baked, help="most Cycles samples of a place whose light is baked", widget={"soft_max": 1024},
    ).as_field()  # fmt: skip
    cells: str = Setting(
        "Light Cells", "Surface that gets fine light", LIGHT, Kind.CHOICE, SEEN_CELLS,
        choices=(
            (SEEN_CELLS, "Seen by Cameras", "As fine as the pixels of the job's cameras need, coarse elsewhere"),
            (ALL_CELLS, "Everywhere", "As fine as the voxels, for exports and other cameras; takes far longer"),
        ),
        counts=_is_baked, place=Place.ADVANCED, argument="--light-cells",
        help="surface that gets fine light: seen by cameras, or everywhere",
    ).as_field()  # fmt: skip
    denoise: bool = Setting(
        "Denoise",
        "Remove noise from the baked light by averaging neighboring light cells; shadows, edges and textures are kept",
        LIGHT, Kind.SWITCH, True, counts=_is_baked, help="remove noise from baked light",
    ).as_field()  # fmt: skip
    gloss: str = Setting(
        "Gloss", "Reflections to bake, and their viewpoint", LIGHT, Kind.CHOICE, GLOSS_AUTO,
        choices=(
            (GLOSS_AUTO, "Automatic", "Metals and mirrors, seen from the active camera's present place, or from above "
             "for several cameras"),
            (GLOSS_OFF, "Off", "None: metals and mirrors are black, glass is opaque"),
            (GLOSS_ABOVE, "From Above", "All materials, seen from above the surface"),
            (GLOSS_CAMERA, "From Camera", "All materials, seen from the active camera's present place"),
        ),
        counts=_is_baked, help="reflections to bake, and their viewpoint",
    ).as_field()  # fmt: skip
    device: str = Setting(
        "Bake Device", "Device that Cycles bakes on", LIGHT, Kind.CHOICE, AUTO,
        choices=(
            (AUTO, "Automatic", "A GPU if the preferences of Cycles enable one, else the CPU"),
            (CPU, "CPU", "All cores of the CPU"),
            (GPU, "GPU", "GPUs that the preferences of Cycles enable; an error if there is none"),
        ),
        effect=Effect.NEVER, counts=_is_baked, place=Place.ADVANCED,
        argument="--bake-device", help="device that Cycles bakes on",
    ).as_field()  # fmt: skip
    exposure: float | None = Setting(
        "Exposure",
        "Factor on the light of the voxels; a higher one brightens pictures, 0 makes bright surfaces white",
        LIGHT, Kind.AUTOMATIC, None, bounds.EXPOSURE,
        place=Place.ADVANCED, help="factor on luminance (the one that brings its 99.5 %% quantile to 1)", unit="FACTOR",
        widget={"precision": 4}, automatic="By Brightest", first=1.0,
    ).as_field()  # fmt: skip
    color: bool = Setting(
        "Keep Color",
        "Store color as well as luminance; takes two more bytes per voxel and twice the memory while baking",
        LIGHT, Kind.SWITCH, True,
        place=Place.ADVANCED, help="keep color beside luminance, for pictures and exports",
    ).as_field()  # fmt: skip
    sides: str = Setting(
        "Voxel Sides", "Light that a voxel shows along a ray", LIGHT, Kind.CHOICE, SIX_SIDES,
        choices=(
            (SIX_SIDES, "Six", "Of the surface that faces the ray, so that thin walls have a lit and a dark side; up "
             "to three more bytes per voxel"),
            (ONE_SIDE, "One", "The mean of all surfaces in the voxel, as in the paper"),
        ),
        place=Place.ADVANCED, help="light of a voxel by direction, or one mean",
    ).as_field()  # fmt: skip
    daylight: bool | None = None
    from_camera: bool | None = None

    def __post_init__(self) -> None:
        check_values(self)

    @property
    def has_sides(self) -> bool:
        """Return whether voxels show light by direction."""
        return self.sides == SIX_SIDES

    @property
    def is_baked(self) -> bool:
        """Return whether Cycles computes the light."""
        return self.kind == CYCLES


def _torch_name(device: str) -> str:
    return CUDA if device == GPU else device.lower()


@dataclass(frozen=True)
class NetworkSettings:
    """Settings of the look-ahead network. weights: file; None for the shipped ones. device: of encoding, AUTO, CPU or
    GPU, or as torch names one, cuda:1.
    """

    weights: Path | None = Setting(
        "Weights", "File with the weights of the network; empty uses the included one", CODES, Kind.FILE,
        help="weights file instead of the one that is shipped", automatic="Shipped",
    ).as_field()  # fmt: skip
    device: str = Setting(
        _NETWORK_DEVICE, "Device that the network encodes on; results are the same up to rounding",
        CODES, Kind.CHOICE, AUTO,
        name="network_device",
        choices=(
            (AUTO, "Automatic", "A GPU where torch has one, else the CPU"),
            (CPU, "CPU", "All cores of the CPU, without torch if none is there"),
            (GPU, "GPU", "An NVIDIA GPU through torch; an error if there is none"),
        ),
        check=lambda name: read_device(_torch_name(name), NETWORK_DEVICE),
        effect=Effect.NEVER, argument="--device",
        help="device of the network's encoder; auto: a GPU if torch has one (auto)",
    ).as_field()  # fmt: skip

    def __post_init__(self) -> None:
        check_values(self)

    @property
    def torch_device(self) -> str:
        """Device that the network runs on, as torch names it: auto, cpu, cuda or cuda:N."""
        return _torch_name(self.device)


def samples_side(samples: float) -> int:
    """Rays per pixel side of the square number nearest to `samples`."""
    return max(1, round(math.sqrt(samples)))


def picture_settings(values: Any, pixel_filter: PixelFilter) -> PictureSettings:
    """Settings of the pictures of render engine and viewports. values: `ViewSettings`, or the properties of a scene."""
    if values.render_samples:
        return PictureSettings(None, side=samples_side(values.render_samples), pixel_filter=pixel_filter)
    budget = values.budget, values.spp or None, values.refined_samples
    return PictureSettings(values.strategy, values.unrefined, *budget, pixel_filter=pixel_filter)


def _has_budget(values: Any) -> bool:
    return not values.spp


_IMPORTANCE_IMAGE = Setting(
    "Image", "Painted image", IMPORTANCE, Kind.TEXT,
    name="importance_image", counts=lambda values: values.importance == IMAGE,
    argument="--mask-image", unit="NAME",
    help="painted importance, by the name of an image of the .blend file; black pixels are never refined",
)  # fmt: skip
_IMPORTANCE_GROUP = Setting(
    "Vertex Group", "Painted vertex group", IMPORTANCE, Kind.TEXT,
    name="importance_group", counts=lambda values: values.importance == VERTEX_GROUP,
    argument="--mask-group", help="painted importance, by the name of a vertex group of the objects", unit="NAME",
)  # fmt: skip


@dataclass(frozen=True)
class ViewSettings:
    """Settings of the views: cameras, order of refinement, and display.

    cameras: names, or ("all",), or ("auto",); empty for the scene's active camera.
    size: a height of 0 follows the render aspect, (0, 0) is the render resolution.
    unrefined: methods 3.12b. refined_samples, spp: spread by priority (methods 7.25b). reference: of whole jobs.
    render_samples: of every pixel in renders of the engine and its viewport; None refines by priority there, too.
    importance: painted importance; None if all pixels matter alike. cycles: render of the worst pixels by Cycles over
    the preview; None for none.
    """

    cameras: tuple[str, ...] = Setting(
        "Cameras",
        "Cameras to render, with commas between: names, all, auto for views of the scene, inside for views of a room, "
        "or a place and its target as X Y Z > X Y Z; empty uses the active camera",
        CAMERAS, Kind.TEXT, (),
        help="names with commas between, all, auto for views of the scene, inside where it is a room, or place and "
        "target as 'X Y Z > X Y Z', with '@ DEGREES' for an angle of view (the active camera)",
        automatic="Active Camera",
    ).as_field()  # fmt: skip
    size: tuple[int, int] = Setting(
        "Picture Size",
        "Size of the pictures in pixels; one 0 keeps the render aspect, two use the render resolution",
        CAMERAS, Kind.PAIR, (192, 0), bounds.SIZE_PX,
        place=Place.FIRST, help="pixels of the pictures; a 0 follows the render aspect, 0 0 is the render resolution",
        automatic="By Aspect", first=(192, 108),
    ).as_field()  # fmt: skip
    strategy: str = Setting(
        "Strategy", "Order in which pixels are refined", VIEW, Kind.CHOICE, DEFAULT,
        choices=tuple((item.name, item.title, item.description) for item in STRATEGIES.values()), check=strategy,
        gone=frozenset({3}),  # patchnet-plus-staged of 1.0.0
        help=f"order of refinement ({DEFAULT}): "
        + ", ".join(f"{item.name} ({item.cost})" for item in STRATEGIES.values()),
    ).as_field()  # fmt: skip
    unrefined: str = Setting(
        "Unrefined Pixels", "Picture in pixels that are not refined", VIEW, Kind.CHOICE, PREVIEW,
        choices=(
            (PREVIEW, "Preview", "The voxel at the pixel's center"),
            (PREDICTED, "Predicted", "The network's estimate of each pixel, with one further ray"),
        ),
        help="picture in pixels that are not refined",
    ).as_field()  # fmt: skip
    budget: float = Setting(
        "Pixel Budget", "Share of the pixels to refine; more lower the error and take longer",
        VIEW, Kind.SHARE, 0.3, bounds.BUDGET,
        active=_has_budget, place=Place.FIRST, help="share of active pixels to refine, 0 to 1",
    ).as_field()  # fmt: skip
    refined_samples: float = Setting(
        "Refine Samples",
        "Mean samples per refined pixel; more lower the error and take longer, and go to pixels of high priority",
        VIEW, Kind.NUMBER, 64.0, bounds.REFINED_SAMPLES,
        active=_has_budget, help="mean samples of refined pixels, 16 to 1024, by priority",
        widget={"soft_max": 256.0, "precision": 0},
    ).as_field()  # fmt: skip
    spp: float | None = Setting(
        "Pixel Samples",
        "Mean samples per pixel, more where the priority is high; 0 refines the share set by Pixel Budget instead",
        VIEW, Kind.AUTOMATIC, None, bounds.SPP,
        help="mean samples per active pixel, 1 to 1024, by priority, instead of a share", unit="MEAN",
        widget={"soft_max": 64.0}, automatic="By Budget", first=16.0,
    ).as_field()  # fmt: skip
    render_samples: float | None = Setting(
        "Render Samples",
        "Rays per pixel of renders and viewports; more smooth edges and take longer, 0 refines by priority and gives "
        "the passes Priority and Coverage",
        RENDERS, Kind.AUTOMATIC, 16.0, bounds.SPP,
        argument="", widget={"soft_max": 64.0, "precision": 0}, automatic="By Priority", first=16.0,
    ).as_field()  # fmt: skip
    reference: bool = Setting(
        "Always Compare",
        "Trace 32 x 32 rays in every pixel of all previews and measure the error of all strategies; takes far longer",
        VIEW, Kind.SWITCH, False, effect=Effect.PERHAPS,
        place=Place.COMPARE, help="also trace 32 x 32 rays in every pixel, and state the errors of all strategies",
    ).as_field()  # fmt: skip
    background: str = Setting(
        "Background", "Background of pictures, behind all surfaces", VIEW, Kind.CHOICE, AUTO,
        choices=(
            (AUTO, "As Film", "The world, or nothing where the scene's Film is transparent"),
            (WORLD, "World", "The world as Cycles shows it to cameras, in the exposure of the picture"),
            (BLACK_BACKGROUND, "Black", "Black"),
            (TRANSPARENT, "Transparent", "Nothing: pictures have an alpha channel"),
        ),
        place=Place.ADVANCED, help="background of pictures, behind all surfaces",
    ).as_field()  # fmt: skip
    heatmap_maximum: float | None = Setting(
        "Heatmap Max",
        "Priority at the bright end of the heatmap; a higher one darkens it, 0 uses that of the strategy",
        VIEW, Kind.AUTOMATIC, None, bounds.HEATMAP_MAXIMUM, effect=Effect.PERHAPS,
        place=Place.ADVANCED, argument="--heatmap-max", help="priority at the end of the heatmap's legend",
        automatic="By Strategy", first=0.1,
    ).as_field()  # fmt: skip
    colormap: str = COLORMAPS[0]
    importance: Importance | None = Setting(
        "Painted Weights",
        "Painted weights that multiply the priority; 1 or white keeps it, 0 or black is never refined",
        IMPORTANCE, Kind.CHOICE, None, shown=NOTHING,
        choices=(
            (NOTHING, "None", "All pixels have the same weight"),
            (IMAGE, "Image", "An image painted in an Image Editor, stretched over the picture of each view"),
            (VERTEX_GROUP, "Vertex Group", "Weights painted on objects; objects without the group are never refined"),
        ),
        check=lambda _: None,  # an `Importance` has checked itself
        argument="",
    ).as_field(after=(_IMPORTANCE_IMAGE, _IMPORTANCE_GROUP))  # fmt: skip
    cycles: CyclesSettings | None = None

    def __post_init__(self) -> None:
        check_values(self)
        if self.colormap not in COLORMAPS:
            known = ", ".join(COLORMAPS)
            raise SettingError(f"There is no color map {self.colormap!r}: choose one of {known}")

    @property
    def has_reference(self) -> bool:
        """Return whether a job's views have a reference: by the setting, or since the strategy ranks by it."""
        return self.reference or REFERENCE in strategy(self.strategy).needs

    @property
    def budget_text(self) -> str:
        """Budget in words, after "refined with"."""
        return f"a budget of {self.budget:.0%}" if self.spp is None else f"{self.spp:g} samples per pixel"
