# SPDX-License-Identifier: GPL-3.0-or-later
"""Table of all settings of a job and of its refinement with Cycles, each declared once.

Properties of scenes and operators (`properties/`), arguments of commands (`commands/shared/job_arguments.py`), checks
of numbers (`settings/groups.py`), what makes a step stale (`settings/job_settings.py`) and keys of caches are derived.
The group of each row is that of the field that holds it: `SETTING_PATHS` of `settings/job_settings.py`.
"""

from __future__ import annotations

from typing import Any

from ...patchnet_addon.runtime import bounds
from ...patchnet_addon.sampling.predicted import PREDICTED, PREVIEW
from ...patchnet_addon.sampling.registry import DEFAULT, STRATEGIES
from .setting import Effect, Kind, Setting

AUTO = "AUTO"
SELECTED, VISIBLE = "SELECTED", "VISIBLE"
DEPTH, VOXEL_SIZE = "DEPTH", "VOXEL_SIZE"
CYCLES, TWO_LIGHTS = "cycles", "two-lights"
CPU, GPU = "CPU", "GPU"
WORLD, BLACK_BACKGROUND, TRANSPARENT = "world", "black", "transparent"
GLOSS_AUTO, GLOSS_OFF, GLOSS_ABOVE, GLOSS_CAMERA = "auto", "off", "above", "camera"
SIX_SIDES, ONE_SIDE = "six", "one"
EXACT_SHAPE, BOX_SHAPE, WHOLE_SHAPE = "exact", "boxes", "whole"
DIFFUSE, COMBINED = "diffuse", "combined"
SEEN_CELLS, ALL_CELLS = "seen", "everywhere"
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
        "scope", "Objects", "Objects that become voxels", OCTREE, Kind.CHOICE, AUTO,
        choices=(
            (AUTO, "Automatic", "Selected objects in a window, all visible ones in background"),
            (SELECTED, "Selected", "Selected objects"),
            (VISIBLE, "Visible", "All objects that render, hidden in viewports or not"),
        ),
    ),
    Setting(
        "resolution", "Voxel Detail", "Size of the finest voxels", OCTREE, Kind.CHOICE, AUTO,
        choices=(
            (AUTO, "Automatic", "Fine voxels where cameras see the surface, coarse ones elsewhere"),
            (DEPTH, "Octree Depth", "Set the number of levels"),
            (VOXEL_SIZE, "Voxel Size", "Set the side of the finest voxels"),
        ),
        field_name="depth",
    ),
    Setting(
        "depth", "Octree Depth",
        "Levels of the octree; each further one halves the voxels and takes four times the memory",
        OCTREE, Kind.NUMBER, 9, bounds.DEPTH,
        counts=lambda values: values.resolution == DEPTH,
    ),
    Setting(
        "voxel_size", "Voxel Size", "Side of the finest voxels; smaller ones show finer detail and take more memory",
        OCTREE, Kind.NUMBER, 0.01, bounds.VOXEL_SIZE,
        field_name="voxel_size_world", counts=lambda values: values.resolution == VOXEL_SIZE,
        widget={"unit": "LENGTH", "precision": 4},
    ),
    Setting(
        "track", "All Frames",
        "Fit the voxels to the cameras at all frames of the scene instead of the current one",
        OCTREE, Kind.SWITCH, False, counts=lambda values: values.resolution == AUTO,
    ),
    Setting(
        "track_frames", "Track",
        "First and last frame that voxels are fitted to with All Frames, whatever is rendered; twice 0: those of the "
        "scene",
        OCTREE, Kind.PAIR, (0, 0), bounds.FRAME, counts=lambda values: values.resolution == AUTO and values.track,
        automatic="Scene's",
    ),
    Setting(
        "shape", "Surface in Voxels", "Where rays that reach the finest voxels end", OCTREE, Kind.CHOICE, EXACT_SHAPE,
        choices=(
            (EXACT_SHAPE, "Exact", "On the surface itself, whose textures are as sharp as pixels; voxels take twice as "
             "much memory"),
            (BOX_SHAPE, "Boxes", "On the box around the surface in a voxel"),
            (WHOLE_SHAPE, "Whole", "On the voxel"),
        ),
        argument="--surface", help="where rays that reach the finest voxels end",
    ),
    Setting(
        "memory", "Memory (GiB)",
        "Memory limit while the octree is built; a higher one allows smaller voxels, 0 uses all free memory",
        OCTREE, Kind.AUTOMATIC, None, bounds.MEMORY_GIB, field_name="memory_bytes", effect=Effect.PERHAPS,
        argument="--memory", help="memory limit while the octree is built (all free memory)", unit="GIB",
        widget={"soft_max": 64.0, "precision": 1}, automatic="All Free", first=4.0,
    ),
)  # fmt: skip

_LIGHT = (
    Setting(
        "light", "Light", "Light that the voxels store", LIGHT, Kind.CHOICE, CYCLES,
        choices=(
            (CYCLES, "Cycles", "Direct and indirect light, emission and textures, baked by Cycles"),
            (TWO_LIGHTS, "Two Lights", "Two opposite lights without shadows, as in the paper, without a bake"),
        ),
        argument="--light", help="light",
    ),
    Setting(
        "noise_threshold", "Noise Threshold",
        "Noise at which light is no longer refined, as in Cycles' own sampling; lower ones take longer",
        LIGHT, Kind.NUMBER, 0.03, bounds.NOISE_THRESHOLD,
        counts=_baked, argument="--noise-threshold", help="noise of pixels at which light is no longer refined",
        widget={"precision": 4, "step": 0.1},
    ),
    Setting(
        "max_samples", "Max Samples",
        "Most paths of each place whose light is baked; more reduce noise and take longer",
        LIGHT, Kind.NUMBER, 32, bounds.SAMPLES,
        counts=_baked, argument="--max-samples", help="most Cycles samples of a place whose light is baked",
        widget={"soft_max": 1024},
    ),
    Setting(
        "cells", "Light Cells", "Surface that gets fine light", LIGHT, Kind.CHOICE, SEEN_CELLS,
        choices=(
            (SEEN_CELLS, "Seen by Cameras", "As fine as the pixels of the job's cameras need, coarse elsewhere"),
            (ALL_CELLS, "Everywhere", "As fine as the voxels, for exports and other cameras; takes far longer"),
        ),
        counts=_baked, argument="--light-cells", help="surface that gets fine light: seen by cameras, or everywhere",
    ),
    Setting(
        "denoise", "Denoise",
        "Remove noise from the baked light by averaging neighboring light cells; shadows, edges and textures are kept",
        LIGHT, Kind.SWITCH, True, counts=_baked, argument="--denoise", help="remove noise from baked light",
    ),
    Setting(
        "gloss", "Gloss", "Reflections to bake, and their viewpoint",
        LIGHT, Kind.CHOICE, GLOSS_AUTO,
        choices=(
            (GLOSS_AUTO, "Automatic", "Metals and mirrors, seen from the active camera's present place, or from above "
             "for several cameras"),
            (GLOSS_OFF, "Off", "None: metals and mirrors are black, glass is opaque"),
            (GLOSS_ABOVE, "From Above", "All materials, seen from above the surface"),
            (GLOSS_CAMERA, "From Camera", "All materials, seen from the active camera's present place"),
        ),
        counts=_baked, argument="--gloss", help="reflections to bake, and their viewpoint",
    ),
    Setting(
        "device", "Bake Device", "Device that Cycles bakes on", LIGHT, Kind.CHOICE, AUTO,
        choices=(
            (AUTO, "Automatic", "A GPU if the preferences of Cycles enable one, else the CPU"),
            (CPU, "CPU", "All cores of the CPU"),
            (GPU, "GPU", "GPUs that the preferences of Cycles enable; an error if there is none"),
        ),
        effect=Effect.NEVER, counts=_baked,
        argument="--bake-device", help="device that Cycles bakes on",
    ),
    Setting(
        "exposure", "Exposure",
        "Factor on the light of the voxels; a higher one brightens pictures, 0 makes bright surfaces white",
        LIGHT, Kind.AUTOMATIC, None, bounds.EXPOSURE,
        argument="--exposure", help="factor on luminance (the one that brings its 99.5 %% quantile to 1)",
        unit="FACTOR",
        widget={"precision": 4}, automatic="By Brightest", first=1.0,
    ),
    Setting(
        "color", "Keep Color",
        "Store color as well as luminance; takes two more bytes per voxel and twice the memory while baking",
        LIGHT, Kind.SWITCH, True,
        argument="--color", help="keep color beside luminance, for pictures and exports",
    ),
    Setting(
        "sides", "Voxel Sides", "Light that a voxel shows along a ray", LIGHT, Kind.CHOICE, SIX_SIDES,
        choices=(
            (SIX_SIDES, "Six", "Of the surface that faces the ray, so that thin walls have a lit and a dark side; up "
             "to three more bytes per voxel"),
            (ONE_SIDE, "One", "The mean of all surfaces in the voxel, as in the paper"),
        ),
        argument="--sides", help="light of a voxel by direction, or one mean",
    ),
)  # fmt: skip

_NETWORK = (
    Setting(
        "weights", "Weights", "File with the weights of the network; empty uses the included one", CODES, Kind.FILE,
        argument="--weights", help="weights file instead of the one that is shipped",
    ),
    Setting(
        "network_device", "Network Device", "Device that the network encodes on; results are the same up to rounding",
        CODES, Kind.CHOICE, AUTO,
        choices=(
            (AUTO, "Automatic", "A GPU where torch has one, else the CPU"),
            (CPU, "CPU", "All cores of the CPU, without torch if none is there"),
            (GPU, "GPU", "An NVIDIA GPU through torch; an error if there is none"),
        ),
        effect=Effect.NEVER,
    ),
)  # fmt: skip

_VIEWS = (
    Setting(
        "cameras", "Cameras",
        "Cameras to render, with commas between: names, all, auto for views of the scene, inside for views of a room, "
        "or a place and its target as X Y Z > X Y Z; empty uses the active camera",
        CAMERAS, Kind.TEXT, argument="--cameras",
        help="names with commas between, all, auto for views of the scene, inside where it is a room, or place and "
        "target as 'X Y Z > X Y Z', with '@ DEGREES' for an angle of view (the active camera)",
    ),
    Setting(
        "size", "Picture Size",
        "Size of the pictures in pixels; one 0 keeps the render aspect, two use the render resolution",
        CAMERAS, Kind.PAIR, (192, 0), bounds.SIZE_PX, automatic="By Aspect", first=(192, 108),
    ),
    Setting(
        "strategy", "Strategy", "Order in which pixels are refined", VIEW, Kind.CHOICE, DEFAULT,
        choices=tuple((item.name, item.title, item.description) for item in STRATEGIES.values()),
    ),
    Setting(
        "unrefined", "Unrefined Pixels",
        "Picture in pixels that are not refined",
        VIEW, Kind.CHOICE, PREVIEW,
        choices=(
            (PREVIEW, "Preview", "The voxel at the pixel's center"),
            (PREDICTED, "Predicted", "The network's estimate of each pixel, with one further ray"),
        ),
        argument="--unrefined", help="picture in pixels that are not refined",
    ),
    Setting(
        "budget", "Pixel Budget", "Share of the pixels to refine; more lower the error and take longer",
        VIEW, Kind.SHARE, 0.3, bounds.BUDGET,
        argument="--budget", help="share of active pixels to refine, 0 to 1",
    ),
    Setting(
        "refined_samples", "Refine Samples",
        "Mean samples per refined pixel; more lower the error and take longer, and go to pixels of high priority",
        VIEW, Kind.NUMBER, 64.0, bounds.REFINED_SAMPLES,
        argument="--refined-samples", help="mean samples of refined pixels, 16 to 1024, by priority",
        widget={"soft_max": 256.0, "precision": 0},
    ),
    Setting(
        "spp", "Pixel Samples",
        "Mean samples per pixel, more where the priority is high; 0 refines the share set by Pixel Budget instead",
        VIEW, Kind.AUTOMATIC, None, bounds.SPP,
        argument="--spp", help="mean samples per active pixel, 1 to 1024, by priority, instead of a share", unit="MEAN",
        widget={"soft_max": 64.0}, automatic="By Budget", first=16.0,
    ),
    Setting(
        "render_samples", "Render Samples",
        "Rays per pixel of renders and viewports; more smooth edges and take longer, 0 refines by priority and gives "
        "the passes Priority and Coverage",
        RENDERS, Kind.AUTOMATIC, 16.0, bounds.SPP,
        widget={"soft_max": 64.0, "precision": 0}, automatic="By Priority", first=16.0,
    ),
    Setting(
        "reference", "Always Compare",
        "Trace 32 x 32 rays in every pixel of all previews and measure the error of all strategies; takes far longer",
        VIEW, Kind.SWITCH, False, effect=Effect.PERHAPS,
        argument="--reference", help="also trace 32 x 32 rays in every pixel, and state the errors of all strategies",
    ),
    Setting(
        "background", "Background",
        "Background of pictures, behind all surfaces",
        VIEW, Kind.CHOICE, AUTO,
        choices=(
            (AUTO, "As Film", "The world, or nothing where the scene's Film is transparent"),
            (WORLD, "World", "The world as Cycles shows it to cameras, in the exposure of the picture"),
            (BLACK_BACKGROUND, "Black", "Black"),
            (TRANSPARENT, "Transparent", "Nothing: pictures have an alpha channel"),
        ),
        argument="--background", help="background of pictures, behind all surfaces",
    ),
    Setting(
        "heatmap_maximum", "Heatmap Max",
        "Priority at the bright end of the heatmap; a higher one darkens it, 0 uses that of the strategy",
        VIEW, Kind.AUTOMATIC, None, bounds.HEATMAP_MAXIMUM, effect=Effect.PERHAPS,
        argument="--heatmap-max", help="priority at the end of the heatmap's legend",
        automatic="By Strategy", first=0.1,
    ),
    Setting(
        "importance", "Painted Weights",
        "Painted weights that multiply the priority; 1 or white keeps it, 0 or black is never refined",
        IMPORTANCE, Kind.CHOICE, NOTHING,
        choices=(
            (NOTHING, "None", "All pixels have the same weight"),
            (IMAGE, "Image", "An image painted in an Image Editor, stretched over the picture of each view"),
            (VERTEX_GROUP, "Vertex Group", "Weights painted on objects; objects without the group are never refined"),
        ),
    ),
    Setting(
        "importance_image", "Image", "Painted image", IMPORTANCE, Kind.TEXT, field_name="importance",
        counts=lambda values: values.importance == IMAGE,
        argument="--mask-image", unit="NAME",
        help="painted importance, by the name of an image of the .blend file; black pixels are never refined",
    ),
    Setting(
        "importance_group", "Vertex Group", "Painted vertex group", IMPORTANCE, Kind.TEXT,
        field_name="importance", counts=lambda values: values.importance == VERTEX_GROUP,
        argument="--mask-group", help="painted importance, by the name of a vertex group of the objects", unit="NAME",
    ),
    Setting(
        "out", "Output", "Folder for pictures, octree and report; empty saves nothing", OUTPUT, Kind.FOLDER,
        effect=Effect.NEVER,
    ),
)  # fmt: skip

_REFINEMENT = (
    Setting(
        "cycles_budget", "Cycles Pixels",
        "Share of the pixels that Cycles renders, by priority; more lower the error and take longer",
        REFINEMENT, Kind.SHARE, 0.2, bounds.CYCLES_BUDGET,
    ),
    Setting(
        "cycles_samples", "Cycles Samples", "Samples per pixel that Cycles renders; more reduce noise and take longer",
        REFINEMENT, Kind.NUMBER, 64, bounds.CYCLES_SAMPLES,
    ),
    Setting(
        "cycles_light", "Passes", "Light in the pixels that Cycles renders", REFINEMENT, Kind.CHOICE, DIFFUSE,
        choices=(
            (DIFFUSE, "Diffuse", "Diffuse light and emission, as the voxels around them do"),
            (COMBINED, "Combined", "All light, gloss and glass too; pixels with gloss then stand out"),
        ),
    ),
    Setting(
        "cycles_compare", "Compare to Full",
        "Also render the whole picture and a reference with four times the samples, and report time and error of both; "
        "takes far longer",
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
