# SPDX-License-Identifier: GPL-3.0-or-later
"""View of a lit and coded octree by one camera: its buffers, its pictures, its figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.image.background import BLACK, encoded, opaque, over
from ...patchnet_addon.image.colormaps import colormap
from ...patchnet_addon.image.contact_sheet import contact_sheet
from ...patchnet_addon.image.heatmap import error_picture, heatmap, overlay, tint
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.progress import Progress, Steps, labelled
from ...patchnet_addon.runtime.quantities import error_text
from ...patchnet_addon.runtime.worker import computed, run_in_worker
from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ...patchnet_addon.sampling.predicted import PREDICTED, PREVIEW, UNREFINED
from ...patchnet_addon.sampling.ranking import Ranking, rank
from ...patchnet_addon.sampling.refine import refinable
from ...patchnet_addon.sampling.refined_picture import RefinedPicture, refined_view, samples_report
from ...patchnet_addon.sampling.registry import STRATEGIES, strategy
from ...patchnet_addon.sampling.report import predicted_report, shown_errors, view_report
from ...patchnet_addon.sampling.strategy import Strategy
from ...patchnet_addon.sampling.trace import trace_view
from ...patchnet_addon.sampling.uniform import uniform_report
from ...patchnet_addon.tracing.camera import Camera
from ...patchnet_addon.tracing.pixel_filter import BOX_FILTER, PixelFilter
from ..cycles.background import BLACK_GROUND, Background, background
from ..importance.pixels import pixel_importance
from ..scene_access.images import ERROR_MAXIMUM, PICTURES, PRIORITY_NAME, save_exr, save_png
from ..schema.values import CYCLES
from ..settings.groups import ViewSettings
from ..settings.job_settings import JobSettings
from .unfinished import Ground, Meanwhile, Unfinished, first_look, shown_meanwhile


@dataclass(frozen=True, eq=False)
class View:
    """Result of a camera.

    ranking: of its pixels by the chosen strategy. refined: the picture after the budget is spent.
    pictures: name -> (h, w, 3) encoded colours; those of PICTURES, and "priority" and "order", which are the heatmap
    and the overlay without legend. Those that show light alone are (h, w, 4) without a background, alpha last.
    background: behind all surfaces, (3,) or (P, 3) linear and unexposed, None for transparent. report: figures.
    warnings: why the picture is empty or black, if it is.
    """

    octree: Octree
    camera: Camera
    ranking: Ranking
    refined: RefinedPicture
    pictures: dict[str, np.ndarray]
    report: dict[str, Any]
    warnings: tuple[str, ...] = ()
    background: np.ndarray | None = None

    @property
    def strategy(self) -> str:
        """Name of the chosen strategy."""
        return self.ranking.strategy.name

    @property
    def buffers(self) -> PixelBuffers:
        """Traced pixels, with all inputs of strategies."""
        return self.ranking.buffers

    @property
    def errors(self) -> tuple[float, float] | None:
        """Mean squared error over active pixels of the unrefined and the refined picture; None without a reference."""
        return shown_errors(self.report)

    @property
    def priority(self) -> np.ndarray:
        """(H, W) float32: priority of each pixel."""
        return self.buffers.picture(self.ranking.priority)


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
    buffers = yield from _traced(coded, camera, [chosen], reference=False)
    if settings.importance is not None:
        looked_up = pixel_importance(settings.importance, scope, coded.octree.grid, buffers)
        buffers = replace(buffers, importance=(yield from labelled(looked_up, f"{camera.name}: {{}}")))
    buffers = replace(buffers, unrefined=settings.unrefined)
    ranking = yield from computed(
        lambda: rank(chosen, buffers, settings.budget), Progress(0, 1, f"{camera.name}: Ranking pixels")
    )
    if meanwhile is not None:
        urgent = buffers.picture(ranking.priority) / np.float32(settings.heatmap_maximum or chosen.maximum)
        meanwhile(Unfinished(camera.name, "heatmap", colormap(urgent, settings.colormap)))
    refined = yield from _refined(coded.octree, ranking, settings, meanwhile, ground, pixel_filter)
    strategies = list(STRATEGIES.values()) if compare else [chosen]
    if compare:
        known = yield from _traced(coded, camera, strategies, reference=True, pixel_filter=pixel_filter)
        buffers = replace(known, importance=buffers.importance, unrefined=settings.unrefined)
    measuring = Progress(0, 1, f"{camera.name}: {'Measuring errors' if compare else 'Preparing pictures'}")

    def measure() -> View:
        rankings = _rankings(buffers, strategies, ranking)
        return _measured(coded.octree, ground, rankings, refined, settings)

    made = yield from computed(measure, measuring)
    made = replace(made, warnings=(*made.warnings, *background.warnings))
    if compare:
        uniform = run_in_worker(lambda: uniform_report(coded.octree, camera, buffers), measuring)
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
    coded: CodedOctree,
    camera: Camera,
    strategies: Sequence[Strategy],
    *,
    reference: bool,
    pixel_filter: PixelFilter = BOX_FILTER,
) -> Steps[PixelBuffers]:
    """Trace the inputs of strategies and of the predicted picture, and the reference if wanted."""
    tracing = run_in_worker(
        lambda: trace_view(
            coded.octree,
            camera,
            strategies,
            coded=coded,
            reference=reference,
            unrefined=PREDICTED,
            pixel_filter=pixel_filter,
        ),
        Progress(0, 1, "Tracing the preview"),
    )
    return (yield from labelled(tracing, f"{camera.name}: {{}}"))


def _rankings(buffers: PixelBuffers, strategies: Sequence[Strategy], chosen: Ranking) -> dict[str, dict[str, Ranking]]:
    """Rankings by strategy, for each picture that unrefined pixels can show; without a reference, `chosen` alone."""
    if buffers.reference is None:
        return {buffers.unrefined: {chosen.strategy.name: chosen}}
    views = {name: replace(buffers, unrefined=name) for name in UNREFINED}
    return {name: {item.name: rank(item, view, chosen.budget) for item in strategies} for name, view in views.items()}


def _refined(
    octree: Octree,
    ranking: Ranking,
    settings: ViewSettings,
    meanwhile: Meanwhile | None,
    ground: Ground,
    pixel_filter: PixelFilter,
) -> Steps[RefinedPicture]:
    """Spend the budget on a ranked view: samples per pixel if they are given, else a share of the pixels."""
    begun: list[RefinedPicture] = []
    camera = ground.camera

    def make() -> Steps[RefinedPicture]:
        spp = settings.spp
        samples = ranking.refined_samples(settings.refined_samples) if spp is None else ranking.samples(spp)
        return refined_view(octree, camera, ranking, samples, pixel_filter, begun=begun.append)

    tracing = run_in_worker(make, Progress(0, 1, "Refining by priority"))
    if meanwhile is not None:
        tracing = shown_meanwhile(tracing, begun, ground, meanwhile)
    return (yield from labelled(tracing, f"{camera.name}: {{}}"))


def _measured(
    octree: Octree,
    ground: Ground,
    rankings: Mapping[str, Mapping[str, Ranking]],
    refined: RefinedPicture,
    settings: ViewSettings,
) -> View:
    """Figures and pictures of a refined view; errors of the preview are always reported."""
    from ...patchnet_addon.tracing.empty_view import why_unseen

    camera, chosen = ground.camera, rankings[settings.unrefined][settings.strategy]
    buffers = chosen.buffers
    seen = (buffers.preview, refined.luminance, *([] if buffers.reference is None else [buffers.reference]))
    unseen = why_unseen(octree, camera, buffers.hits, max(float(values.max()) for values in seen))
    paper = list(rankings.get(PREVIEW, {}).values())
    report = view_report(paper[0].buffers if paper else buffers, camera.name, settings.budget, paper)
    report["unrefined"] = settings.unrefined
    if buffers.reference is not None:
        predicted = list(rankings[PREDICTED].values())
        report["predicted"] = predicted_report(predicted[0].buffers, predicted)
    asked = {"samples": settings.refined_samples} if settings.spp is None else {"spp": settings.spp}
    report["refined"] = asked | samples_report(chosen, refined)
    if settings.importance is not None:
        report["refinable_pixels"] = refinable(buffers)
    made = View(octree, camera, chosen, refined, {}, report, () if unseen is None else (unseen,), ground.background)
    return replace(made, pictures=_pictures(made, settings))


def _pictures(made: View, settings: ViewSettings) -> dict[str, np.ndarray]:
    """Pictures of a view; those with a legend are magnified, others have the camera's size.

    Pictures of light are in colour if the octree is. The overlay stays gray, so that red always means refined first.
    """
    name, ranking, refined = made.camera.name, made.ranking, made.refined
    buffers, chosen, ramp = ranking.buffers, ranking.strategy, settings.colormap
    picture = buffers.picture
    maximum = settings.heatmap_maximum or chosen.maximum
    urgent = picture(ranking.priority)
    first = picture(ranking.urgency(refined.refined_count))
    ground = BLACK if made.background is None else made.background
    below = picture(over(buffers.shown, buffers.shown_alpha, ground, made.octree.exposure))
    pictures = {
        **_lit_pictures(made),
        "priority": colormap(urgent / np.float32(maximum), ramp),
        "heatmap": heatmap(urgent, maximum, chosen.quantity, map_name=ramp, title=f"{name}: {chosen.name}"),
        "order": tint(below, first),
        "overlay": overlay(below, first, settings.budget_text, title=f"{name}: order of refinement"),
    }
    if buffers.reference is not None and made.errors is not None:
        before, after = (picture(np.abs(values - buffers.reference)) for values in (buffers.shown, refined.luminance))
        unrefined = settings.unrefined
        pictures["error"] = error_picture(before, after, ERROR_MAXIMUM, made.errors, map_name=ramp, unrefined=unrefined)
    return pictures


def _lit_pictures(made: View) -> dict[str, np.ndarray]:
    """Pictures of light over the view's background: preview, predicted, refined, and the reference if there is one."""
    buffers, refined = made.buffers, made.refined
    looks = {
        "preview": (buffers.preview, buffers.preview_color, buffers.preview_alpha),
        "predicted": (buffers.predicted, buffers.predicted_color, buffers.predicted_alpha),
        "refined": (refined.luminance, refined.colors, refined.alpha),
        "reference": (buffers.reference, buffers.reference_color, buffers.reference_alpha),
    }
    ground = made.background, made.octree.exposure
    return {
        item: buffers.picture(encoded(gray if color is None else color, alpha, *ground))
        for item, (gray, color, alpha) in looks.items()
        if gray is not None and alpha is not None  # both exist, or neither
    }


def overview(views: Sequence[View]) -> np.ndarray:
    """Overview of all cameras in one picture: a row each, from the preview to the refined picture or the reference."""
    titles = {
        "preview": "preview", "predicted": "predicted", "priority": "priority", "order": "refined first: red",
        "refined": "refined",
    }  # fmt: skip
    if all("reference" in item.pictures for item in views):
        titles["reference"] = "reference"
    rows = [[opaque(item.pictures[name]) for name in titles] for item in views]
    names = []
    for item in views:
        figures = ": error x 10,000 {} -> {}".format(*map(error_text, item.errors)) if item.errors else ""
        names.append(item.camera.name + figures)
    return contact_sheet(rows, names, tuple(titles.values()))


def save_view(result: View, folder: Path) -> None:
    """Write the view's pictures into `folder`, a new one."""
    folder.mkdir()
    for name in PICTURES:
        if name in result.pictures:
            save_png(folder / f"{name}.png", result.pictures[name])
    save_exr(folder / PRIORITY_NAME, result.priority)
