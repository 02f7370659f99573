# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures and figures of a view of a lit and coded octree."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.image.background import BLACK, Ground, encoded, opaque, over
from ...patchnet_addon.image.colormaps import colormap
from ...patchnet_addon.image.contact_sheet import contact_sheet
from ...patchnet_addon.image.heatmap import error_picture, heatmap, overlay, tint
from ...patchnet_addon.image.unfinished import Unfinished
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.progress import Progress, Steps, changed
from ...patchnet_addon.runtime.quantities import error_text
from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ...patchnet_addon.sampling.predicted import PREDICTED, PREVIEW, UNREFINED
from ...patchnet_addon.sampling.ranking import Ranking, rank
from ...patchnet_addon.sampling.refine import refinable
from ...patchnet_addon.sampling.refined_picture import RefinedPicture, refined_view, samples_report
from ...patchnet_addon.sampling.registry import STRATEGIES, strategy
from ...patchnet_addon.sampling.report import predicted_report, shown_errors, view_report
from ...patchnet_addon.sampling.strategy import Strategy
from ...patchnet_addon.sampling.strokes import Painted
from ...patchnet_addon.sampling.trace import trace_view
from ...patchnet_addon.sampling.uniform import uniform_report
from ...patchnet_addon.tracing.camera import Camera
from ...patchnet_addon.tracing.pixel_filter import PixelFilter
from ..settings.groups import ViewSettings

ERROR_MAXIMUM = 0.5  # luminance error at the end of an error picture's legend
_COVERAGE_RAYS = 8  # a pixel side
_SHOWN_S = 1.0  # between two pictures of a refinement


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


def first_picture(octree: Octree, ground: Ground) -> np.ndarray:
    """(H, W, 3) encoded colours of the first ray of every pixel, over the background."""
    from ...patchnet_addon.tracing.render import first_hits, seen_color

    hits = first_hits(octree, ground.camera)
    light = hits.luminance if octree.chroma is None else seen_color(octree, hits.node, hits.direction)
    return opaque(ground.picture(light, hits.hit.astype(np.float32)))


def viewed(
    coded: CodedOctree,
    ground: Ground,
    settings: ViewSettings,
    importance: Painted | None,
    pixel_filter: PixelFilter,
    shows: bool,
) -> Steps[View]:
    """Preview, predicted picture, priority and refinement of a camera's view, with pictures and figures.

    With `reference` of the settings, also the reference of all pixels, and the errors of all strategies and of uniform
    pictures. importance: which the caller fills in. shows: some reports bring an `Unfinished` picture.
    """
    octree, camera, chosen = coded.octree, ground.camera, strategy(settings.strategy)
    ranking_pixels, strategies = Progress(0, 1, "Ranking pixels"), [chosen]
    if shows:
        preview = Unfinished(camera.name, "preview", first_picture(octree, ground))
        yield Progress(0, 1, "Tracing the preview", partial=preview)
    buffers = yield from trace_view(octree, camera, [chosen], coded=coded, reference=False, unrefined=PREDICTED)
    if importance is not None:
        buffers = replace(buffers, importance=(yield from importance(buffers)))
    buffers = replace(buffers, unrefined=settings.unrefined)
    yield ranking_pixels
    ranking = rank(chosen, buffers, settings.budget)
    if shows:
        maximum = np.float32(settings.heatmap_maximum or chosen.maximum)
        urgent = colormap(buffers.picture(ranking.priority) / maximum, settings.colormap)
        yield replace(ranking_pixels, partial=Unfinished(camera.name, "heatmap", urgent))
    refined = yield from _refined(octree, ranking, settings, ground, pixel_filter, shows)
    if settings.reference:
        strategies = list(STRATEGIES.values())
        tracing = trace_view(octree, camera, strategies, coded=coded, unrefined=PREDICTED, pixel_filter=pixel_filter)
        buffers = replace((yield from tracing), importance=buffers.importance, unrefined=settings.unrefined)
    yield Progress(0, 1, "Measuring errors" if settings.reference else "Preparing pictures")
    made = _measured(octree, ground, _rankings(buffers, strategies, ranking), refined, settings)
    if settings.reference:
        made.report["uniform"] = yield from uniform_report(octree, camera, buffers)
    return made


def _refined(
    octree: Octree, ranking: Ranking, settings: ViewSettings, ground: Ground, pixel_filter: PixelFilter, shows: bool
) -> Steps[RefinedPicture]:
    """Spend the budget on a ranked view: samples per pixel if they are given, else a share of the pixels."""
    spp, last = settings.spp, time.monotonic()
    begun: list[RefinedPicture] = []
    samples = ranking.refined_samples(settings.refined_samples) if spp is None else ranking.samples(spp)

    def shown(report: Progress) -> Progress:
        nonlocal last
        if not (shows and begun) or time.monotonic() - last < _SHOWN_S:
            return report
        last = time.monotonic()
        picture = opaque(ground.picture(begun[0].colors, begun[0].alpha))
        return replace(report, partial=Unfinished(ground.camera.name, f"refining, {report.fraction:.0%}", picture))

    steps = refined_view(octree, ground.camera, ranking, samples, pixel_filter, begun=begun.append)
    return (yield from changed(steps, shown))


def mean_and_coverage(octree: Octree, camera: Camera, rays: int) -> Steps[tuple[np.ndarray, np.ndarray]]:
    """Picture of an octree (H, W) with rays x rays in a pixel, and its coverage of each pixel (H, W)."""
    from ...patchnet_addon.tracing.supersample import supersample

    shape = camera.height_px, camera.width_px
    luminance = (yield from supersample(octree, camera, rays)).luminance.reshape(shape)
    return luminance, (yield from supersample(octree, camera, min(_COVERAGE_RAYS, rays))).coverage.reshape(shape)


def reason_unseen(octree: Octree, camera: Camera, brightest: float) -> str | None:
    """Reason why a camera's picture is empty or black, None if it is not. brightest: its largest luminance."""
    from ...patchnet_addon.tracing.empty_view import why_unseen
    from ...patchnet_addon.tracing.render import first_hits

    return why_unseen(octree, camera, first_hits(octree, camera), brightest)


def _rankings(buffers: PixelBuffers, strategies: Sequence[Strategy], chosen: Ranking) -> dict[str, dict[str, Ranking]]:
    """Rankings by strategy, for each picture that unrefined pixels can show; without a reference, `chosen` alone."""
    if buffers.reference is None:
        return {buffers.unrefined: {chosen.strategy.name: chosen}}
    views = {name: replace(buffers, unrefined=name) for name in UNREFINED}
    return {name: {item.name: rank(item, view, chosen.budget) for item in strategies} for name, view in views.items()}


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
