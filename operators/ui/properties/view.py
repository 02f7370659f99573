# SPDX-License-Identifier: GPL-3.0-or-later
"""Properties of views: cameras, strategy and budget, and painted importance."""

from __future__ import annotations

from bpy.props import EnumProperty, IntVectorProperty, StringProperty

from ....patchnet_addon.runtime.bounds import BUDGET, HEATMAP_MAXIMUM, SIZE_PX
from ....patchnet_addon.sampling.registry import STRATEGIES
from ...importance import IMAGE, NOTHING, VERTEX_GROUP
from ...settings.job_settings import JobSettings
from .shapes import automatic_at_zero, share

_STRATEGY_ITEMS = [(item.name, item.title, item.description) for item in STRATEGIES.values()]


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
        default=JobSettings.size,
        min=int(SIZE_PX.low),
        max=int(SIZE_PX.high),
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

    strategy: EnumProperty(
        name="Strategy", description="What is refined first", items=_STRATEGY_ITEMS, default=JobSettings.strategy
    )
    budget: share("Budget", "Share of active pixels to refine", JobSettings.budget, BUDGET)
    heatmap_maximum: automatic_at_zero(
        "Heatmap Max", "Priority at the end of the heatmap's legend; 0 takes the strategy's own", HEATMAP_MAXIMUM
    )
