# SPDX-License-Identifier: GPL-3.0-or-later
"""Properties of the light: the source of luminance."""

from __future__ import annotations

from bpy.props import BoolProperty, EnumProperty

from ....patchnet_addon.runtime.bounds import EXPOSURE, SAMPLES, TEXEL_VOXELS
from ...settings.job_settings import CYCLES, TWO_LIGHTS, JobSettings
from .shapes import automatic_at_zero, device_choice, number


class LightProperties:
    """Where luminance comes from."""

    light: EnumProperty(
        name="Light",
        description="Where the luminance of the voxels comes from",
        items=[
            (CYCLES, "Cycles", "Direct and indirect light, emission and textures, baked by Cycles"),
            (TWO_LIGHTS, "Two Lights", "Two opposite lights without shadows, as in the paper; takes no time"),
        ],
        default=JobSettings.light,
    )
    samples: number("Samples", "Cycles samples of each baked texel", JobSettings.samples, SAMPLES, soft_max=256)
    texel_voxels: number(
        "Texel Size",
        "Side of a baked texel in finest voxels: smaller texels take longer and show finer shadows",
        JobSettings.texel_voxels,
        TEXEL_VOXELS,
    )
    exposure: automatic_at_zero(
        "Exposure",
        "Factor on the luminance of the voxels; 0 chooses it by the brightest of the surface",
        EXPOSURE,
        precision=4,
    )
    both_sides: BoolProperty(
        name="Both Sides",
        description="Voxels of opaque sheets hold the mean of both sides, for meshes whose normals point anywhere; "
        "otherwise the side that normals show. Leaves and other cut-outs always hold the mean",
        default=JobSettings.both_sides,
    )
    color: BoolProperty(
        name="Keep Color",
        description="Keep color beside luminance, so that previews, shown voxels and exports are in color: two bytes "
        "more a node, and twice the memory of baked light",
        default=JobSettings.color,
    )
    device: device_choice(
        "Bake Device",
        "What Cycles bakes on",
        automatic="A GPU if the preferences of Cycles enable one, else the CPU",
        cpu="All cores of the CPU",
        gpu="GPUs that the preferences of Cycles enable; an error if there is none",
    )
