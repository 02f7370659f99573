# SPDX-License-Identifier: GPL-3.0-or-later
"""View of a lit and coded octree by one camera: its buffers, its pictures, its figures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import bpy

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.image.background import Ground
from ...patchnet_addon.image.unfinished import Meanwhile
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.process.computed import computed
from ...patchnet_addon.runtime.progress import Progress, Steps, changed
from ...patchnet_addon.tracing.camera import Camera
from ...patchnet_addon.tracing.pixel_filter import BOX_FILTER, PixelFilter
from ..computing.views import View, viewed
from ..cycles.background import BLACK_GROUND, Background, background
from ..importance.pixels import read_strokes
from ..scene_access.images import PICTURES, PRIORITY_NAME, save_exr, save_png
from ..schema.values import CYCLES
from ..settings.groups import ViewSettings
from ..settings.job_settings import JobSettings


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
    octree, strokes = coded.octree, read_strokes(settings.importance, scope, bpy.context.evaluated_depsgraph_get())
    ground, tracing = Ground(camera, background.light, octree.exposure), Progress(0, 1, "Tracing the preview")
    wanted = settings, strokes.weights(octree.grid), pixel_filter, meanwhile is not None
    steps = strokes.answering(computed(viewed, coded, ground, *wanted, at=tracing))

    def shown(report: Progress) -> Progress:
        if report.partial is not None and meanwhile is not None:
            meanwhile(report.partial)
        return replace(report, label=f"{camera.name}: {report.label}", partial=None)

    made: View = yield from changed(steps, shown)
    return replace(made, warnings=(*made.warnings, *background.warnings))


def view_background(
    context: bpy.types.Context, octree: Octree, camera: Camera, settings: JobSettings
) -> Steps[Background]:
    """Background of a camera of a job in the context's scene."""
    baked = octree.provenance.get("light") == CYCLES
    depsgraph, daylight = context.evaluated_depsgraph_get(), settings.light.daylight
    return (yield from background(depsgraph, camera, settings.view.background, baked=baked, daylight=daylight))


def save_view(result: View, folder: Path) -> None:
    """Write the view's pictures into `folder`, a new one."""
    folder.mkdir()
    for name in PICTURES:
        if name in result.pictures:
            save_png(folder / f"{name}.png", result.pictures[name])
    save_exr(folder / PRIORITY_NAME, result.priority)
