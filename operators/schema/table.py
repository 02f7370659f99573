# SPDX-License-Identifier: GPL-3.0-or-later
"""Table of all settings of a job and of its refinement with Cycles, each declared once.

Properties of scenes and operators (`properties/`), arguments of commands (`commands/shared/job_arguments.py`), checks
of numbers (`settings/groups.py`), what makes a step stale (`settings/job_settings.py`) and keys of caches are derived.
The group of each row is that of the field that holds it: `SETTING_PATHS` of `settings/job_settings.py`.
"""

from __future__ import annotations

from typing import Any

from ...patchnet_addon.network.devices import OTHER_PYTHON
from ...patchnet_addon.runtime import bounds
from ...patchnet_addon.sampling.predicted import PREDICTED, PREVIEW
from ...patchnet_addon.sampling.registry import DEFAULT, STRATEGIES
from .setting import Effect, Kind, Setting

AUTO = "AUTO"
SELECTED, VISIBLE = "SELECTED", "VISIBLE"
DEPTH, VOXEL_SIZE, FIT = "DEPTH", "VOXEL_SIZE", "FIT"
CYCLES, TWO_LIGHTS = "cycles", "two-lights"
CPU, GPU = "CPU", "GPU"
WORLD, BLACK_BACKGROUND, TRANSPARENT = "world", "black", "transparent"
GLOSS_AUTO, GLOSS_OFF, GLOSS_ABOVE, GLOSS_CAMERA = "auto", "off", "above", "camera"
SIX_SIDES, ONE_SIDE = "six", "one"
DIFFUSE, COMBINED = "diffuse", "combined"
NOTHING, IMAGE, VERTEX_GROUP = "NONE", "IMAGE", "VERTEX_GROUP"
# Stages of a job.
OCTREE, LIGHT, CODES, CAMERAS, VIEW, IMPORTANCE, OUTPUT, REFINEMENT = (
    "octree", "light", "codes", "cameras", "view", "importance", "output", "refinement",
)  # fmt: skip
RENDERS = "renders"  # of the render engine, which no job makes


def _baked(values: Any) -> bool:
    return bool(values.light == CYCLES)


_SURFACE = (
    Setting(
        "scope", "Objects", "Which objects are voxelized", OCTREE, Kind.CHOICE, AUTO,
        choices=(
            (AUTO, "Automatic", "Selected objects in a window, all visible ones in background"),
            (SELECTED, "Selected", "Selected objects"),
            (VISIBLE, "Visible", "All objects that are visible and rendered"),
        ),
    ),
    Setting(
        "resolution", "Resolution", "How the side of the finest voxels is found", OCTREE, Kind.CHOICE, AUTO,
        choices=(
            (AUTO, "By Cameras", "The smallest depth at which the cameras see two levels ahead nearly everywhere"),
            (FIT, "Fit to Cameras", "Fine only where cameras see the surface, coarse elsewhere: for large pictures"),
            (DEPTH, "Depth", "A number of levels: every level halves the voxels"),
            (VOXEL_SIZE, "Voxel Size", "A length in the scene's units"),
        ),
        field_name="fit",
    ),
    Setting(
        "depth", "Depth", "Levels of the octree", OCTREE, Kind.NUMBER, 9, bounds.DEPTH,
        counts=lambda values: values.resolution == DEPTH,
    ),
    Setting(
        "voxel_size", "Voxel Size", "Side of the finest voxels", OCTREE, Kind.NUMBER, 0.01, bounds.VOXEL_SIZE,
        field_name="voxel_size_world", counts=lambda values: values.resolution == VOXEL_SIZE,
        widget={"unit": "LENGTH", "precision": 4},
    ),
    Setting(
        "track", "All Frames",
        "Fit the voxels to the cameras at all frames of the scene, not only at the present one",
        OCTREE, Kind.SWITCH, False, counts=lambda values: values.resolution == FIT,
        argument="--track", help="with --depth fit: the cameras at all frames of the scene",
    ),
    Setting(
        "memory", "Memory (GiB)", "Memory that the octree may take while it is built; 0 takes all that is free",
        OCTREE, Kind.AUTOMATIC, None, bounds.MEMORY_GIB, field_name="memory_bytes", effect=Effect.PERHAPS,
        argument="--memory", help="what the octree may take while it is built (all)", unit="GIB",
        widget={"soft_max": 64.0, "precision": 1}, automatic="All Free", first=4.0,
    ),
)  # fmt: skip

_LIGHT = (
    Setting(
        "light", "Light", "Where the luminance of the voxels comes from", LIGHT, Kind.CHOICE, CYCLES,
        choices=(
            (CYCLES, "Cycles", "Direct and indirect light, emission and textures, baked by Cycles"),
            (TWO_LIGHTS, "Two Lights", "Two opposite lights without shadows, as in the paper; takes no time"),
        ),
        argument="--light", help="light",
    ),
    Setting(
        "samples", "Samples", "Cycles samples of each baked texel", LIGHT, Kind.NUMBER, 4, bounds.SAMPLES,
        counts=_baked, argument="--samples", help="Cycles samples per baked texel", widget={"soft_max": 256},
    ),
    Setting(
        "denoise", "Denoise",
        "Average baked light with that of the texels around, where they differ by no more than its noise. Shadows, "
        "edges and textures stay",
        LIGHT, Kind.SWITCH, True, counts=_baked, argument="--denoise", help="take the noise out of baked light",
    ),
    Setting(
        "texel_voxels", "Texel (Voxels)",
        "Side of a baked texel in finest voxels: smaller texels take longer and show finer shadows",
        LIGHT, Kind.NUMBER, 2.0, bounds.TEXEL_VOXELS, counts=_baked,
        argument="--texel-voxels", help="side of a baked texel in finest voxels",
    ),
    Setting(
        "gloss", "Gloss", "Whose reflections are baked, and from where they are seen; clear glass is see-through",
        LIGHT, Kind.CHOICE, GLOSS_AUTO,
        choices=(
            (GLOSS_AUTO, "Automatic", "Of metals and mirrors, which would be black: as the active camera sees them, "
             "where it is now, or as seen from above where other cameras look, too"),
            (GLOSS_OFF, "Off", "Diffuse light and emission alone: metals and mirrors are black, glass is opaque"),
            (GLOSS_ABOVE, "From Above", "Of all materials, as seen from above the surface"),
            (GLOSS_CAMERA, "From Camera", "Of all materials, as the active camera sees it where it is now"),
        ),
        counts=_baked, argument="--gloss", help="whose reflections are baked, and from where they are seen",
    ),
    Setting(
        "device", "Bake Device", "What Cycles bakes on", LIGHT, Kind.CHOICE, AUTO,
        choices=(
            (AUTO, "Automatic", "A GPU if the preferences of Cycles enable one, else the CPU"),
            (CPU, "CPU", "All cores of the CPU"),
            (GPU, "GPU", "GPUs that the preferences of Cycles enable; an error if there is none"),
        ),
        effect=Effect.NEVER, counts=_baked,
        argument="--bake-device", help="what Cycles bakes on",
    ),
    Setting(
        "exposure", "Exposure", "Factor on the luminance of the voxels; 0 chooses it by the brightest of the surface",
        LIGHT, Kind.AUTOMATIC, None, bounds.EXPOSURE,
        argument="--exposure", help="factor on luminance (the one that brings its 99.5 %% quantile to 1)",
        unit="FACTOR",
        widget={"precision": 4}, automatic="By Brightest", first=1.0,
    ),
    Setting(
        "color", "Keep Color",
        "Keep color beside luminance, so that previews, shown voxels and exports are in color: two bytes more a node, "
        "and twice the memory of baked light",
        LIGHT, Kind.SWITCH, True,
        argument="--color", help="keep color beside luminance, for pictures and exports",
    ),
    Setting(
        "sides", "Sides", "Which light a voxel shows", LIGHT, Kind.CHOICE, SIX_SIDES,
        choices=(
            (SIX_SIDES, "Six", "That of the surface which faces the ray: thin plates have two sides, no table shines "
             "through its cloth. Up to three bytes more a node"),
            (ONE_SIDE, "One", "The mean of all surface in it, from everywhere, as in the paper"),
        ),
        argument="--sides", help="light of a voxel by direction, or one mean",
    ),
)  # fmt: skip

_NETWORK = (
    Setting(
        "weights", "Weights", "Weights file; empty for the one that is shipped", CODES, Kind.FILE,
        argument="--weights", help="weights file instead of the one that is shipped",
    ),
    Setting(
        "network_device", "Network On", "What the network encodes on; results differ by rounding alone",
        CODES, Kind.CHOICE, AUTO,
        choices=(
            (AUTO, "Automatic", "A GPU where torch has one, else CPU"
             + ("; the Python of the preferences encodes if one is named" if OTHER_PYTHON else "")),
            (CPU, "CPU", "All cores of the CPU, without torch if none is there"),
            (GPU, "GPU", "An NVIDIA GPU through torch; an error if there is none"),
        ),
        effect=Effect.NEVER,
    ),
)  # fmt: skip

_VIEWS = (
    Setting(
        "cameras", "Cameras",
        "Cameras that look: one, all of the scene, auto for views of the scene, inside where it is a room; or a "
        "place and its target as X Y Z > X Y Z. Several have commas between. Empty for the active camera",
        CAMERAS, Kind.TEXT, argument="--cameras",
        help="names with commas between, all, auto for views of the scene, inside where it is a room, or place and "
        "target as 'X Y Z > X Y Z', with '@ DEGREES' for an angle of view (the active camera)",
    ),
    Setting(
        "size", "Picture Size",
        "Pixels of the pictures; 0 follows the render aspect, twice 0 is the render resolution",
        CAMERAS, Kind.PAIR, (192, 0), bounds.SIZE_PX, automatic="By Aspect", first=(192, 108),
    ),
    Setting(
        "strategy", "Strategy", "What is refined first", VIEW, Kind.CHOICE, DEFAULT,
        choices=tuple((item.name, item.title, item.description) for item in STRATEGIES.values()),
    ),
    Setting(
        "unrefined", "Unrefined",
        "What pixels show that are not refined; priorities are of what is wrong in that picture",
        VIEW, Kind.CHOICE, PREVIEW,
        choices=(
            (PREVIEW, "Preview", "The voxel that one ray meets"),
            (PREDICTED, "Predicted", "What the network expects of voxel and background, with one further ray a pixel"),
        ),
        argument="--unrefined", help="what pixels show that are not refined",
    ),
    Setting(
        "budget", "Budget", "Share of active pixels to refine", VIEW, Kind.SHARE, 0.3, bounds.BUDGET,
        argument="--budget", help="share of active pixels to refine, 0 to 1",
    ),
    Setting(
        "refined_samples", "Refined Samples",
        "Mean samples of the pixels that Budget refines, spread by priority: 16, 64 or 256 in each, and 1,024 where "
        "the mean is above 256",
        VIEW, Kind.NUMBER, 64.0, bounds.REFINED_SAMPLES,
        argument="--refined-samples", help="mean samples of refined pixels, 16 to 1024, by priority",
        widget={"soft_max": 256.0, "precision": 0},
    ),
    Setting(
        "spp", "Pixel Samples",
        "Mean samples per active pixel, spread by priority: 1, 4, 16, 64, 256 or 1,024 in each; 0 refines the share "
        "that Budget says",
        VIEW, Kind.AUTOMATIC, None, bounds.SPP,
        argument="--spp", help="mean samples per active pixel, 1 to 1024, by priority, instead of a share", unit="MEAN",
        widget={"soft_max": 64.0}, automatic="By Budget", first=16.0,
    ),
    Setting(
        "render_samples", "Render Samples",
        "Rays in every pixel of renders and of the viewport, 16 as 4 x 4; 0 refines by priority, as previews do, and "
        "gives the passes Priority and Coverage",
        RENDERS, Kind.AUTOMATIC, 16.0, bounds.SPP,
        widget={"soft_max": 64.0, "precision": 0}, automatic="By Priority", first=16.0,
    ),
    Setting(
        "reference", "In All Previews",
        "Preview Selection and Render Preview, too, trace 32 x 32 rays in every pixel and measure the error of all "
        "strategies against them: takes far longer",
        VIEW, Kind.SWITCH, False, effect=Effect.PERHAPS,
        argument="--reference", help="also trace 32 x 32 rays in every pixel, and state the errors of all strategies",
    ),
    Setting(
        "background", "Background",
        "What pictures show where no surface is. Priorities and errors are those of surfaces alone",
        VIEW, Kind.CHOICE, AUTO,
        choices=(
            (AUTO, "As Film", "The world, or nothing where the scene's Film is transparent"),
            (WORLD, "World", "The world as Cycles shows it to cameras, in the exposure of the picture"),
            (BLACK_BACKGROUND, "Black", "Black"),
            (TRANSPARENT, "Transparent", "Nothing: pictures have an alpha channel"),
        ),
        argument="--background", help="what pictures show where no surface is",
    ),
    Setting(
        "heatmap_maximum", "Heatmap Max", "Priority at the end of the heatmap's legend; 0 takes the strategy's own",
        VIEW, Kind.AUTOMATIC, None, bounds.HEATMAP_MAXIMUM, effect=Effect.PERHAPS,
        argument="--heatmap-max", help="priority at the end of the heatmap's legend",
        automatic="By Strategy", first=0.1,
    ),
    Setting(
        "importance", "Importance",
        "What multiplies the priority of each pixel: white or weight 1 leaves it, black or 0 never refines",
        IMPORTANCE, Kind.CHOICE, NOTHING,
        choices=(
            (NOTHING, "None", "All pixels matter alike"),
            (IMAGE, "Image", "An image painted in an Image Editor, stretched over the picture of each view"),
            (VERTEX_GROUP, "Vertex Group", "Weights painted on objects; objects without the group are never refined"),
        ),
    ),
    Setting(
        "importance_image", "Image", "Name of the painted image", IMPORTANCE, Kind.TEXT, field_name="importance",
        counts=lambda values: values.importance == IMAGE,
        argument="--mask-image", help="painted importance, by the name of an image of the .blend file", unit="NAME",
    ),
    Setting(
        "importance_group", "Vertex Group", "Name of the painted vertex group", IMPORTANCE, Kind.TEXT,
        field_name="importance", counts=lambda values: values.importance == VERTEX_GROUP,
        argument="--mask-group", help="painted importance, by the name of a vertex group of the objects", unit="NAME",
    ),
    Setting(
        "out", "Output", "Folder for pictures, octree and report; empty writes none", OUTPUT, Kind.FOLDER,
        effect=Effect.NEVER,
    ),
)  # fmt: skip

_REFINEMENT = (
    Setting(
        "cycles_budget", "Pixels",
        "Share of the picture's pixels that Cycles renders, those of highest priority",
        REFINEMENT, Kind.SHARE, 0.2, bounds.CYCLES_BUDGET,
    ),
    Setting(
        "cycles_samples", "Cycles Samples", "Samples of each of these pixels",
        REFINEMENT, Kind.NUMBER, 64, bounds.CYCLES_SAMPLES,
    ),
    Setting(
        "cycles_light", "Passes", "What Cycles' pixels show", REFINEMENT, Kind.CHOICE, DIFFUSE,
        choices=(
            (DIFFUSE, "Diffuse", "Diffuse light and emission, as the voxels around them do"),
            (COMBINED, "Combined", "All light, gloss and glass too; pixels with gloss then stand out"),
        ),
    ),
    Setting(
        "cycles_compare", "Compare to Full",
        "Compare with a full render: also render the whole picture with as many samples, and a reference with four "
        "times as many, and measure time and errors of both: takes far longer",
        REFINEMENT, Kind.SWITCH, False,
    ),
)  # fmt: skip

TABLE: dict[str, Setting] = {row.name: row for row in (*_SURFACE, *_LIGHT, *_NETWORK, *_VIEWS)}
CYCLES_TABLE: dict[str, Setting] = {row.name: row for row in _REFINEMENT}  # of `CyclesSettings`


def rows(*stages: str) -> list[Setting]:
    """Settings of some stages, in the order of the table."""
    return [row for row in (*TABLE.values(), *_REFINEMENT) if row.stage in stages]


def result_fields(*stages: str) -> list[str]:
    """Flat names of `JobSettings` on which the results of some stages may depend."""
    return list(dict.fromkeys(row.job_field for row in rows(*stages) if row.effect is not Effect.NEVER))
