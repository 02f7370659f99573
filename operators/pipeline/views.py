# SPDX-License-Identifier: GPL-3.0-or-later
"""View of a lit and coded octree by one camera: its buffers, its pictures, its figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import bpy

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.image.background import Ground
from ...patchnet_addon.image.unfinished import Meanwhile, Unfinished
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.process.computed import computed
from ...patchnet_addon.runtime.progress import Progress, Steps, changed, labelled
from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ...patchnet_addon.sampling.ranking import Ranking, rank
from ...patchnet_addon.sampling.refined_picture import RefinedPicture
from ...patchnet_addon.sampling.registry import STRATEGIES, strategy
from ...patchnet_addon.tracing.camera import Camera
from ...patchnet_addon.tracing.pixel_filter import BOX_FILTER, PixelFilter
from ..computing.views import (
    View,
    measured_view,
    refined_pixels,
    traced_view,
    uniform_figures,
    urgent_picture,
)
from ..cycles.background import BLACK_GROUND, Background, background
from ..importance.pixels import pixel_importance
from ..scene_access.images import PICTURES, PRIORITY_NAME, save_exr, save_png
from ..schema.values import CYCLES
from ..settings.groups import ViewSettings
from ..settings.job_settings import JobSettings
from .unfinished import first_look


def view(
    coded: CodedOctree,
    camera: Camera,
    settings: ViewSettings,
    scope: str,
    *,
    background: Background = BLACK_GROUND,
    pixel_filter: PixelFilter = BOX_FILTER,
    meanwhile: Meanwhile | None = None,
) -> Steps[View]:
    """Preview, predicted picture, priority and refinement of one camera.

    scope: of the voxels, for painted importance, which multiplies the scores of all strategies. With `reference` of the
    settings, also trace the reference of all pixels and measure the error that all strategies, exact oracles and
    uniform pictures leave.
    background: of the pictures; priorities and errors are of surfaces alone. pixel_filter: of the pictures of refined
    pixels and of the reference; errors are of plain means.
    meanwhile: shows the preview, the heatmap, and the picture in refinement. Raises SettingError if the painted image
    or vertex group is missing.
    """
    chosen = strategy(settings.strategy)
    compare = settings.reference
    ground = Ground(camera, background.light, coded.octree.exposure)
    if meanwhile is not None:
        yield from first_look(coded.octree, camera, meanwhile, background=ground.background)
    buffers = yield from _traced(coded, camera, [chosen.name], None)
    if settings.importance is not None:
        looked_up = pixel_importance(settings.importance, scope, coded.octree.grid, buffers)
        buffers = replace(buffers, importance=(yield from labelled(looked_up, f"{camera.name}: {{}}")))
    buffers = replace(buffers, unrefined=settings.unrefined)
    ordering = Progress(0, 1, f"{camera.name}: Ranking pixels")
    ranking = yield from computed(rank, chosen, buffers, settings.budget, at=ordering)
    if meanwhile is not None:
        picture = yield from computed(urgent_picture, ranking, settings, at=ordering)
        meanwhile(Unfinished(camera.name, "heatmap", picture))
    refined = yield from _refined(coded.octree, ranking, settings, meanwhile, ground, pixel_filter)
    if compare:
        compared = yield from _traced(coded, camera, list(STRATEGIES), pixel_filter)
        buffers = replace(compared, importance=buffers.importance, unrefined=settings.unrefined)
    measuring = Progress(0, 1, f"{camera.name}: {'Measuring errors' if compare else 'Preparing pictures'}")
    known = coded.octree, ground, buffers, ranking, refined, settings
    made: View = yield from computed(measured_view, *known, at=measuring)
    made = replace(made, warnings=(*made.warnings, *background.warnings))
    if compare:
        uniform = computed(uniform_figures, coded.octree, camera, buffers, at=Progress(0, 1, "Measuring errors"))
        made.report["uniform"] = yield from labelled(uniform, f"{camera.name}: {{}}")
    return made


def view_background(
    context: bpy.types.Context, octree: Octree, camera: Camera, settings: JobSettings
) -> Steps[Background]:
    """Background of a camera of a job in the context's scene."""
    baked = octree.provenance.get("light") == CYCLES
    depsgraph, daylight = context.evaluated_depsgraph_get(), settings.light.daylight
    return (yield from background(depsgraph, camera, settings.view.background, baked=baked, daylight=daylight))


def _traced(
    coded: CodedOctree, camera: Camera, names: Sequence[str], pixel_filter: PixelFilter | None
) -> Steps[PixelBuffers]:
    """Trace the inputs of strategies and of the predicted picture, and the reference if it gets a pixel filter."""
    tracing = Progress(0, 1, "Tracing the preview")
    steps = computed(traced_view, coded, camera, tuple(names), pixel_filter, at=tracing)
    return (yield from labelled(steps, f"{camera.name}: {{}}"))


def _refined(
    octree: Octree,
    ranking: Ranking,
    settings: ViewSettings,
    meanwhile: Meanwhile | None,
    ground: Ground,
    pixel_filter: PixelFilter,
) -> Steps[RefinedPicture]:
    """Spend the budget on a ranked view, and show the picture meanwhile."""

    def shown(report: Progress) -> Progress:
        if report.partial is not None and meanwhile is not None:
            meanwhile(Unfinished(ground.camera.name, f"refining, {report.fraction:.0%}", report.partial))
        return replace(report, partial=None)

    refining = Progress(0, 1, "Refining by priority")
    steps = computed(refined_pixels, octree, ranking, settings, ground, pixel_filter, at=refining)
    return (yield from labelled(changed(steps, shown), f"{ground.camera.name}: {{}}"))


def save_view(result: View, folder: Path) -> None:
    """Write the view's pictures into `folder`, a new one."""
    folder.mkdir()
    for name in PICTURES:
        if name in result.pictures:
            save_png(folder / f"{name}.png", result.pictures[name])
    save_exr(folder / PRIORITY_NAME, result.priority)
