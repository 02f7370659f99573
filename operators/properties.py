# SPDX-License-Identifier: GPL-3.0-or-later
"""Every setting once: as the scene's settings, and as properties of the operators that use it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
from bpy.props import (
    BoolProperty,
    EnumProperty,
    FloatProperty,
    IntProperty,
    IntVectorProperty,
    PointerProperty,
    StringProperty,
)

from ..patchnet_addon.errors import SettingError
from ..patchnet_addon.octree.grid import MAX_DEPTH
from ..patchnet_addon.sampling.regions import DEFAULT_MOST, DEFAULT_TILE
from ..patchnet_addon.sampling.registry import DEFAULT, STRATEGIES
from .cycles_refine.settings import COMBINED, DIFFUSE, CyclesSettings
from .devices import AUTOMATIC, CPU, GPU
from .importance import IMAGE, NOTHING, VERTEX_GROUP, Importance
from .job.settings import CYCLES, TWO_LIGHTS, JobSettings
from .preferences import Preferences, preferences
from .scene.placements import SELECTED, VISIBLE
from .voxel_object import CUBES, POINTS

_STRATEGY_ITEMS = [(item.name, item.title, item.description) for item in STRATEGIES.values()]


class VoxelizeProperties:
    """What is voxelized, and how finely."""

    scope: EnumProperty(
        name="Objects",
        description="Which objects are voxelized",
        items=[
            ("AUTO", "Automatic", "Selected objects in a window, all visible ones in background"),
            (SELECTED, "Selected", "Selected objects"),
            (VISIBLE, "Visible", "All objects that are visible and rendered"),
        ],
        default="AUTO",
    )
    resolution: EnumProperty(
        name="Resolution",
        description="How the side of the finest voxels is found",
        items=[
            ("AUTO", "By Cameras", "The smallest depth at which the cameras see two levels ahead nearly everywhere"),
            ("FIT", "Fit to Cameras", "Fine only where cameras see the surface, coarse elsewhere: for large pictures"),
            ("DEPTH", "Depth", "A number of levels: every level halves the voxels"),
            ("VOXEL_SIZE", "Voxel Size", "A length in the scene's units"),
        ],
        default="AUTO",
    )
    depth: IntProperty(name="Depth", description="Levels of the octree", default=9, min=1, max=MAX_DEPTH)
    voxel_size: FloatProperty(
        name="Voxel Size", description="Side of the finest voxels", default=0.01, min=1e-6, unit="LENGTH", precision=4
    )
    track: BoolProperty(
        name="Whole Animation",
        description="Fit the voxels to the cameras at all frames of the scene, not only at the present one",
        default=False,
    )
    memory: FloatProperty(
        name="Memory Limit",
        description="GiB that the octree may take while it is built; 0 takes what is free",
        default=0.0,
        min=0.0,
        soft_max=64.0,
    )


class CameraProperties:
    """Whose pictures are made, and how large."""

    cameras: StringProperty(
        name="Cameras",
        description="Names with commas between, 'all', or 'auto' to frame the scene; empty for the active camera",
    )
    size: IntVectorProperty(
        name="Picture Size",
        description="Pixels of the pictures; 0 follows the render aspect, twice 0 is the render resolution",
        size=2,
        default=(192, 0),
        min=0,
        max=16384,
    )


class LightProperties:
    """Where luminance comes from."""

    light: EnumProperty(
        name="Light",
        description="Where the luminance of the voxels comes from",
        items=[
            (CYCLES, "Cycles", "Direct and indirect light, emission and textures, baked by Cycles"),
            (TWO_LIGHTS, "Two Lights", "Two opposite lights without shadows, as in the paper; takes no time"),
        ],
        default=CYCLES,
    )
    samples: IntProperty(
        name="Samples", description="Cycles samples of each baked texel", default=8, min=1, soft_max=256, max=65536
    )
    texel_voxels: FloatProperty(
        name="Texel Size",
        description="Side of a baked texel in finest voxels: smaller texels take longer and show finer shadows",
        default=2.0,
        min=0.25,
        max=16.0,
    )
    exposure: FloatProperty(
        name="Exposure",
        description="Factor on the luminance of the voxels; 0 chooses it by the brightest of the surface",
        default=0.0,
        min=0.0,
        precision=4,
    )
    both_sides: BoolProperty(
        name="Both Sides",
        description="Voxels of opaque sheets hold the mean of both sides, for meshes whose normals point anywhere; "
        "otherwise the side that normals show. Leaves and other cut-outs always hold the mean",
        default=False,
    )
    color: BoolProperty(
        name="Keep Color",
        description="Keep color beside luminance, so that previews, shown voxels and exports are in color: two bytes "
        "more a node, and twice the memory of baked light",
        default=False,
    )
    device: EnumProperty(
        name="Bake Device",
        description="What Cycles bakes on",
        items=[
            (AUTOMATIC, "Automatic", "A GPU if the preferences of Cycles enable one, else the CPU"),
            (CPU, "CPU", "All cores of the CPU"),
            (GPU, "GPU", "GPUs that the preferences of Cycles enable; an error if there is none"),
        ],
        default=AUTOMATIC,
    )


class CodesProperties:
    """Which network looks ahead."""

    weights: StringProperty(
        name="Weights",
        description="Weights file; empty for the one that is shipped",
        subtype="FILE_PATH",
        options={"PATH_SUPPORTS_BLEND_RELATIVE"},
    )
    encoder_device: EnumProperty(
        name="Encode On",
        description="What the network encodes on. The codes are the same",
        items=[
            (
                AUTOMATIC,
                "Automatic",
                "The Python of the preferences if one is named, else a GPU where torch has one, else CPU",
            ),
            (CPU, "CPU", "All cores of the CPU, without torch if none is there"),
            (GPU, "GPU", "An NVIDIA GPU through torch; an error if there is none"),
        ],
        default=AUTOMATIC,
    )


class ImportanceProperties:
    """What matters to the person, painted."""

    importance: EnumProperty(
        name="Importance",
        description="What multiplies the priority of each pixel: white or weight 1 leaves it, black or 0 never refines",
        items=[
            (NOTHING, "None", "All pixels matter alike"),
            (IMAGE, "Image", "An image painted in an Image Editor, stretched over the picture of each view"),
            (VERTEX_GROUP, "Vertex Group", "Weights painted on objects; objects without the group are never refined"),
        ],
        default=NOTHING,
    )
    importance_image: StringProperty(name="Image", description="Name of the painted image")
    importance_group: StringProperty(name="Vertex Group", description="Name of the painted vertex group")


class ViewProperties(ImportanceProperties):
    """What is refined first, and how it is shown."""

    strategy: EnumProperty(name="Strategy", description="What is refined first", items=_STRATEGY_ITEMS, default=DEFAULT)
    budget: FloatProperty(
        name="Budget", description="Share of active pixels to refine", default=0.3, min=0.0, max=1.0, subtype="FACTOR"
    )
    heatmap_maximum: FloatProperty(
        name="Heatmap Max",
        description="Priority at the end of the heatmap's legend; 0 takes the strategy's own",
        default=0.0,
        min=0.0,
    )


class OutputProperties:
    """Where files go."""

    out: StringProperty(
        name="Output",
        description="Folder for pictures, octree and report; empty writes none",
        subtype="DIR_PATH",
        options={"PATH_SUPPORTS_BLEND_RELATIVE"},
    )


class AnimationProperties:
    """How the frames of an animation are baked."""

    skip_existing: BoolProperty(
        name="Skip Finished",
        description="Leave frames alone whose files are complete and are what would be made again; off makes them anew",
        default=True,
    )
    same_grid: BoolProperty(
        name="Same Grid",
        description="Voxels stand at the same places and have the same size at all frames, so that pictures do not swim"
        ": the scene is read at all frames first",
        default=False,
    )


class LevelProperties:
    """Which level is shown or exported."""

    level: IntProperty(
        name="Level",
        description="Level of the voxels, each half as large as on the one before; 0 takes the finest",
        default=0,
        min=0,
        max=MAX_DEPTH,
        options={"SKIP_SAVE"},
    )


class DisplayProperties(LevelProperties):
    """How voxels are shown in the scene. Operators forget them, so that the panel's values count for each call."""

    display: EnumProperty(
        name="Display",
        description="What stands for a voxel",
        items=[
            (CUBES, "Cubes", "A cube of the voxel's size"),
            (POINTS, "Points", "A sphere that fits into the voxel: lighter to draw"),
        ],
        default=CUBES,
        options={"SKIP_SAVE"},
    )
    limit: IntProperty(
        name="Limit",
        description="Voxels at most: where a level has more, a coarser one is shown",
        default=200_000,
        min=1,
        soft_max=5_000_000,
        options={"SKIP_SAVE"},
    )


class CyclesRefineProperties:
    """What Cycles renders of a preview."""

    cycles_budget: FloatProperty(
        name="Pixels",
        description="Share of the picture's pixels that Cycles renders, in rectangles where priority is highest",
        default=0.2,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
    )
    cycles_samples: IntProperty(
        name="Cycles Samples", description="Cycles samples of each of these pixels", default=64, min=1, max=65536
    )
    cycles_light: EnumProperty(
        name="Passes",
        description="What Cycles' pixels show",
        items=[
            (DIFFUSE, "Diffuse", "Diffuse light and emission, as the voxels around them do"),
            (COMBINED, "Combined", "All light, gloss and glass too; regions with gloss then stand out"),
        ],
        default=DIFFUSE,
    )
    cycles_tile: IntProperty(
        name="Tile",
        description="Side in pixels of the tiles that regions are made of: smaller ones follow the heatmap closer",
        default=DEFAULT_TILE,
        min=1,
        soft_min=4,
        max=1024,
    )
    cycles_regions: IntProperty(
        name="Max Regions", description="Regions at most", default=DEFAULT_MOST, min=1, soft_max=32, max=256
    )
    cycles_compare: BoolProperty(
        name="Compare with a Full Render",
        description="Also render the whole picture with as many samples, and a reference with four times as many, and "
        "measure time and errors of both: takes far longer",
        default=False,
    )


class PatchNetSettings(
    VoxelizeProperties,
    CameraProperties,
    LightProperties,
    CodesProperties,
    ViewProperties,
    OutputProperties,
    AnimationProperties,
    DisplayProperties,
    CyclesRefineProperties,
    bpy.types.PropertyGroup,
):
    """Settings that a scene remembers; operators use them for whatever is not given to themselves."""


def job_settings(context: bpy.types.Context, operator: bpy.types.Operator) -> JobSettings:
    """Settings of a job: the operator's properties where they are set, else the scene's.

    Raises SettingError for values that contradict each other or lie outside their range.
    """

    def value(name: str) -> Any:
        return setting(context, operator, name)

    scope = VISIBLE if bpy.app.background else SELECTED
    mine = preferences(context)
    settings = _job_settings(value, _resolution(operator, value("resolution")), scope, mine.colormap)
    return replace(settings, torch_python=absolute_path(mine.torch_python))


def scene_settings(scene: bpy.types.Scene) -> JobSettings:
    """Settings of a job by the scene alone, as its renders take them: automatic scope is all that is visible.

    Raises SettingError.
    """
    values = scene.patchnet
    return _job_settings(lambda name: getattr(values, name), values.resolution, VISIBLE, Preferences().colormap)


def _job_settings(value: Callable[[str], Any], resolution: str, automatic_scope: str, colormap: str) -> JobSettings:
    scope = value("scope")
    return JobSettings(
        scope=automatic_scope if scope == "AUTO" else scope,
        depth=value("depth") if resolution == "DEPTH" else None,
        voxel_world=value("voxel_size") if resolution == "VOXEL_SIZE" else None,
        fit=resolution == "FIT",
        track=resolution == "FIT" and value("track"),
        memory_bytes=int(value("memory") * 2**30) or None,
        light=value("light"),
        samples=value("samples"),
        exposure=value("exposure") or None,
        both_sides=value("both_sides"),
        color=value("color"),
        texel_voxels=value("texel_voxels"),
        cameras=tuple(name.strip() for name in value("cameras").split(",") if name.strip()),
        size=(value("size")[0], value("size")[1]),
        budget=value("budget"),
        strategy=value("strategy"),
        heatmap_maximum=value("heatmap_maximum") or None,
        colormap=colormap,
        weights=absolute_path(value("weights")),
        out=absolute_path(value("out")),
        importance=Importance.chosen(value("importance"), value("importance_image"), value("importance_group")),
        device=value("device"),
        encoder_device=value("encoder_device"),
    )


def cycles_settings(context: bpy.types.Context, operator: bpy.types.Operator) -> CyclesSettings:
    """Settings of a refinement by Cycles, from the operator where they are set, else from the scene."""

    def value(name: str) -> Any:
        return setting(context, operator, f"cycles_{name}")

    return CyclesSettings(
        budget=value("budget"),
        samples=value("samples"),
        tile=value("tile"),
        most=value("regions"),
        light=value("light"),
        compare=value("compare"),
    )


def setting(context: bpy.types.Context, operator: bpy.types.Operator, name: str) -> Any:
    """One setting: the operator's property if its caller set it, else the scene's."""
    return getattr(operator if is_given(operator, name) else context.scene.patchnet, name)


def is_given(operator: bpy.types.Operator, name: str) -> bool:
    """Whether the operator has this property and its caller set it."""
    values = operator.properties
    return name in values.bl_rna.properties and values.is_property_set(name)


def _resolution(operator: bpy.types.Operator, resolution: str) -> str:
    """A depth or voxel size that is given to an operator counts, without naming the resolution too."""
    given = [name for name in ("resolution", "depth", "voxel_size") if is_given(operator, name)]
    if "resolution" in given or not given:
        return resolution
    if len(given) == 2:
        raise SettingError("Depth and voxel size are both given: choose one of them")
    return given[0].upper()


def absolute_path(text: str) -> Path | None:
    """Absolute path of a text that may begin with // for the folder of the .blend file; None for an empty one."""
    if not text:
        return None
    if text.startswith("//") and not bpy.data.filepath:
        raise SettingError(f"Path '{text}' is relative to the .blend file: save the file first")
    return Path(bpy.path.abspath(text)).absolute()


def register() -> None:
    """Give scenes their settings."""
    bpy.utils.register_class(PatchNetSettings)
    bpy.types.Scene.patchnet = PointerProperty(type=PatchNetSettings)


def unregister() -> None:
    """Take the settings away."""
    del bpy.types.Scene.patchnet
    bpy.utils.unregister_class(PatchNetSettings)
