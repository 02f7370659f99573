# SPDX-License-Identifier: GPL-3.0-or-later
"""View of a lit and coded octree by one camera: its buffers, its pictures, its figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.image.colormaps import colormap
from ...patchnet_addon.image.contact_sheet import contact_sheet
from ...patchnet_addon.image.heatmap import error_picture, heatmap, overlay, tint
from ...patchnet_addon.image.tone import shown
from ...patchnet_addon.network.devices import CPU
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.progress import Progress, Steps, labelled
from ...patchnet_addon.runtime.worker import computed, run_in_worker
from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ...patchnet_addon.sampling.predicted import PREDICTED, PREVIEW, UNREFINED
from ...patchnet_addon.sampling.ranking import Ranking, rank
from ...patchnet_addon.sampling.refine import refinable
from ...patchnet_addon.sampling.refined_picture import (
    RefinedPicture,
    refined_by_samples,
    refined_by_share,
    samples_report,
)
from ...patchnet_addon.sampling.registry import STRATEGIES, strategy
from ...patchnet_addon.sampling.report import predicted_report, shown_errors, view_report
from ...patchnet_addon.sampling.strategy import Strategy
from ...patchnet_addon.sampling.trace import trace_view
from ...patchnet_addon.sampling.uniform import uniform_report
from ...patchnet_addon.tracing.camera import Camera
from ..importance.pixels import pixel_importance
from ..scene_access.images import ERROR_MAXIMUM, PICTURES, PRIORITY_NAME, save_exr, save_png
from ..settings.groups import ViewSettings
from .unfinished import Meanwhile, Unfinished, first_look, shown_meanwhile


@dataclass(frozen=True, eq=False)
class View:
    """Result of a camera.

    octree: what was looked at. ranking: of its pixels by the chosen strategy. refined: what the budget made of it.
    pictures: name -> (h, w, 3) encoded colours; those of PICTURES, and "priority" and "order", which are the heatmap
    and the overlay without legend. report: figures.
    warnings: why the picture is empty or black, if it is.
    """

    octree: Octree
    camera: Camera
    ranking: Ranking
    refined: RefinedPicture
    pictures: dict[str, np.ndarray]
    report: dict[str, Any]
    warnings: tuple[str, ...] = ()

    @property
    def strategy(self) -> str:
        """Name of the chosen strategy."""
        return self.ranking.strategy.name

    @property
    def buffers(self) -> PixelBuffers:
        """Traced pixels, and all that strategies read of them."""
        return self.ranking.buffers

    @property
    def errors(self) -> tuple[float, float] | None:
        """Mean squared error over active pixels of what unrefined pixels show, and of the refined picture.

        None without a reference.
        """
        return shown_errors(self.report)

    @property
    def priority(self) -> np.ndarray:
        """(H, W) float32: what pixels are ranked by."""
        return self.buffers.picture(self.ranking.priority)


def view(
    coded: CodedOctree,
    camera: Camera,
    settings: ViewSettings,
    scope: str,
    *,
    compare: bool,
    device: str = CPU,
    meanwhile: Meanwhile | None = None,
) -> Steps[View]:
    """Preview, predicted picture, priority and refinement of one camera.

    scope: which objects were voxelized, for importance that is painted on them. compare: also trace the reference of
    all pixels and measure what all strategies, the exact oracles too, and uniform pictures leave of the error. All
    strategies rank by what the settings' importance makes of their scores. device: what decodes, see `predict`.
    meanwhile: shows the preview as soon as it is traced, the heatmap, and the picture while it is refined. Raises
    SettingError if what was painted, or the device, is not there.
    """
    chosen = strategy(settings.strategy)
    if meanwhile is not None:
        yield from first_look(coded.octree, camera, meanwhile)
    buffers = yield from _traced(coded, camera, [chosen], device, reference=False)
    if settings.importance is not None:
        looked_up = pixel_importance(settings.importance, scope, coded.octree.grid, buffers)
        buffers = replace(buffers, importance=(yield from labelled(looked_up, f"{camera.name}: {{}}")))
    buffers = replace(buffers, unrefined=settings.unrefined)
    ranking = yield from computed(
        lambda: rank(chosen, buffers, settings.budget), Progress(0, 1, f"{camera.name}: Ranking pixels")
    )
    if meanwhile is not None:
        meanwhile(_heatmap(ranking, camera, settings))
    refined = yield from _refined(coded.octree, camera, ranking, settings, meanwhile)
    strategies = list(STRATEGIES.values()) if compare else [chosen]
    if compare:
        known = yield from _traced(coded, camera, strategies, device, reference=True)
        buffers = replace(known, importance=buffers.importance, unrefined=settings.unrefined)
    measuring = Progress(0, 1, f"{camera.name}: {'Preparing pictures' if not compare else 'Measuring errors'}")
    made = yield from computed(
        lambda: _measured(coded.octree, camera, _rankings(buffers, strategies, ranking), refined, settings), measuring
    )
    if compare:
        uniform = run_in_worker(lambda: uniform_report(coded.octree, camera, buffers), measuring)
        made.report["uniform"] = yield from labelled(uniform, f"{camera.name}: {{}}")
    return made


def _traced(
    coded: CodedOctree, camera: Camera, strategies: Sequence[Strategy], device: str, *, reference: bool
) -> Steps[PixelBuffers]:
    """What strategies and the predicted picture need of a view, and its reference if wanted."""
    tracing = run_in_worker(
        lambda: trace_view(
            coded.octree, camera, strategies, coded=coded, reference=reference, device=device, unrefined=PREDICTED
        ),
        Progress(0, 1, "Tracing the preview"),
    )
    return (yield from labelled(tracing, f"{camera.name}: {{}}"))


def _rankings(buffers: PixelBuffers, strategies: Sequence[Strategy], chosen: Ranking) -> dict[str, dict[str, Ranking]]:
    """Rankings by strategy, of what is wrong in each picture that unrefined pixels may show.

    Without a reference only the one that is there, `chosen`.
    """
    if buffers.reference is None:
        return {buffers.unrefined: {chosen.strategy.name: chosen}}
    views = {name: replace(buffers, unrefined=name) for name in UNREFINED}
    return {name: {item.name: rank(item, view, chosen.budget) for item in strategies} for name, view in views.items()}


def _heatmap(ranking: Ranking, camera: Camera, settings: ViewSettings) -> Unfinished:
    maximum = settings.heatmap_maximum or ranking.strategy.maximum
    urgent = ranking.buffers.picture(ranking.priority)
    return Unfinished(camera.name, "heatmap", colormap(urgent / np.float32(maximum), settings.colormap))


def _refined(
    octree: Octree, camera: Camera, ranking: Ranking, settings: ViewSettings, meanwhile: Meanwhile | None
) -> Steps[RefinedPicture]:
    """Spend the budget on a ranked view: samples per pixel where there are any, else its share of the pixels."""
    begun: list[RefinedPicture] = []

    def make() -> Steps[RefinedPicture]:
        if settings.spp is None:
            return refined_by_share(octree, camera, ranking, settings.refined_samples, begun=begun.append)
        return refined_by_samples(octree, camera, ranking, settings.spp, begun=begun.append)

    tracing = run_in_worker(make, Progress(0, 1, "Refining by priority"))
    if meanwhile is not None:
        tracing = shown_meanwhile(tracing, begun, ranking.buffers, camera.name, meanwhile)
    return (yield from labelled(tracing, f"{camera.name}: {{}}"))


def _measured(
    octree: Octree,
    camera: Camera,
    rankings: Mapping[str, Mapping[str, Ranking]],
    refined: RefinedPicture,
    settings: ViewSettings,
) -> View:
    """Figures and pictures of a refined view; errors of the preview are reported whatever unrefined pixels show."""
    from ...patchnet_addon.tracing.unseen import why_unseen

    chosen = rankings[settings.unrefined][settings.strategy]
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
    made = View(octree, camera, chosen, refined, {}, report, () if unseen is None else (unseen,))
    return replace(made, pictures=_pictures(made, settings))


def _pictures(made: View, settings: ViewSettings) -> dict[str, np.ndarray]:
    """Pictures of a view; those with a legend are magnified, the others are as many pixels as the camera has.

    Those that show light are in colour if the octree is. The overlay stays gray, so that red means one thing. The
    reference and errors against it only where there is one.
    """
    name, ranking, refined = made.camera.name, made.ranking, made.refined
    buffers, chosen, ramp = ranking.buffers, ranking.strategy, settings.colormap
    assert buffers.predicted is not None
    picture = buffers.picture
    maximum = settings.heatmap_maximum or chosen.maximum
    below, urgent = picture(buffers.shown), picture(ranking.priority)
    first = picture(ranking.urgency(refined.refined_count))
    gray = {"preview": buffers.preview, "predicted": buffers.predicted, "refined": refined.luminance}
    colors = {"preview": buffers.preview_color, "predicted": buffers.predicted_color, "refined": refined.colors}
    if buffers.reference is not None:
        gray["reference"], colors["reference"] = buffers.reference, buffers.reference_color
    looks = {item: gray[item] if color is None else color for item, color in colors.items()}
    pictures = {
        **{item: shown(picture(values)) for item, values in looks.items()},
        "priority": colormap(urgent / np.float32(maximum), ramp),
        "heatmap": heatmap(urgent, maximum, chosen.quantity, map_name=ramp, title=f"{name}: {chosen.name}"),
        "order": tint(below, first),
        "overlay": overlay(below, first, settings.budget_text, title=f"{name}: order of refinement"),
    }
    if buffers.reference is not None and made.errors is not None:
        before, after = (picture(np.abs(values - buffers.reference)) for values in (buffers.shown, refined.luminance))
        pictures["error"] = error_picture(
            before, after, ERROR_MAXIMUM, made.errors, map_name=ramp, unrefined=settings.unrefined
        )
    return pictures


def overview(views: Sequence[View]) -> np.ndarray:
    """Overview of all cameras in one picture: a row each, from the preview to the refined picture, or the reference."""
    titles = {
        "preview": "preview", "predicted": "predicted", "priority": "priority", "order": "refined first: red",
        "refined": "refined",
    }  # fmt: skip
    if all("reference" in item.pictures for item in views):
        titles["reference"] = "reference"
    rows = [[item.pictures[name] for name in titles] for item in views]
    names = []
    for item in views:
        errors = item.errors
        names.append(item.camera.name + ("" if errors is None else f": mse {errors[0]:.5f} -> {errors[1]:.5f}"))
    return contact_sheet(rows, names, tuple(titles.values()))


def save_view(result: View, folder: Path) -> None:
    """Write the view's pictures into `folder`, a new one."""
    folder.mkdir()
    for name in PICTURES:
        if name in result.pictures:
            save_png(folder / f"{name}.png", result.pictures[name])
    save_exr(folder / PRIORITY_NAME, result.priority)
