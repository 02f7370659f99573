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
    def errors(self) -> tuple[float, float]:
        """Mean squared error over active pixels of what unrefined pixels show, and of the refined picture."""
        return shown_errors(self.report, self.strategy)

    @property
    def priority(self) -> np.ndarray:
        """(H, W) float32: what pixels are ranked by."""
        return self.buffers.picture(self.ranking.priority)


def view(
    coded: CodedOctree, camera: Camera, settings: ViewSettings, scope: str, *, compare: bool, device: str = CPU
) -> Steps[View]:
    """Preview, predicted picture, priority, refinement, reference and errors of one camera.

    scope: which objects were voxelized, for importance that is painted on them. compare: measure all strategies, the
    exact oracles too, not only the chosen one, and uniform pictures. All strategies rank by what the settings'
    importance makes of their scores. device: what decodes, see `predict`. Raises SettingError if what was painted, or
    the device, is not there.
    """
    chosen = strategy(settings.strategy)
    strategies = list(STRATEGIES.values()) if compare else [chosen, STRATEGIES["optimal"]]
    tracing = run_in_worker(
        lambda: trace_view(coded.octree, camera, strategies, coded=coded, device=device, unrefined=PREDICTED),
        Progress(0, 1, "Tracing the preview"),
    )
    buffers = yield from labelled(tracing, f"{camera.name}: {{}}")
    if settings.importance is not None:
        looked_up = pixel_importance(settings.importance, scope, coded.octree.grid, buffers)
        buffers = replace(buffers, importance=(yield from labelled(looked_up, f"{camera.name}: {{}}")))
    measuring = Progress(0, 1, f"{camera.name}: Measuring errors")
    rankings = yield from computed(lambda: _rankings(buffers, strategies, settings.budget), measuring)
    refined = yield from _refined(coded.octree, camera, rankings[settings.unrefined][chosen.name], settings.spp)
    made = yield from computed(lambda: _measured(coded.octree, camera, rankings, refined, settings), measuring)
    if compare:
        uniform = run_in_worker(lambda: uniform_report(coded.octree, camera, buffers), measuring)
        made.report["uniform"] = yield from labelled(uniform, f"{camera.name}: {{}}")
    return made


def _rankings(buffers: PixelBuffers, strategies: Sequence[Strategy], budget: float) -> dict[str, dict[str, Ranking]]:
    """Rankings by strategy, of what is wrong in each picture that unrefined pixels may show."""
    views = {name: replace(buffers, unrefined=name) for name in UNREFINED}
    return {name: {item.name: rank(item, view, budget) for item in strategies} for name, view in views.items()}


def _refined(octree: Octree, camera: Camera, ranking: Ranking, spp: float | None) -> Steps[RefinedPicture]:
    """Spend the budget on a ranked view: samples per pixel where there are any, else its share of the pixels."""
    if spp is None:
        return refined_by_share(ranking)
    tracing = run_in_worker(
        lambda: refined_by_samples(octree, camera, ranking, spp), Progress(0, 1, "Refining by priority")
    )
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
    assert buffers.reference is not None
    unseen = why_unseen(octree, camera, buffers.hits, max(float(buffers.preview.max()), float(buffers.reference.max())))
    paper, predicted = (list(rankings[name].values()) for name in (PREVIEW, PREDICTED))
    report = view_report(paper[0].buffers, camera.name, settings.budget, paper)
    report["unrefined"] = settings.unrefined
    report["predicted"] = predicted_report(predicted[0].buffers, predicted)
    if settings.spp is not None:
        report["spp"] = samples_report(chosen, refined, settings.spp)
    if settings.importance is not None:
        report["refinable_pixels"] = refinable(buffers)
    made = View(octree, camera, chosen, refined, {}, report, () if unseen is None else (unseen,))
    return replace(made, pictures=_pictures(made, settings))


def _pictures(made: View, settings: ViewSettings) -> dict[str, np.ndarray]:
    """Pictures of a view; those with a legend are magnified, the others are as many pixels as the camera has.

    Those that show light are in colour if the octree is. The overlay stays gray, so that red means one thing.
    """
    name, ranking, refined = made.camera.name, made.ranking, made.refined
    buffers, chosen = ranking.buffers, ranking.strategy
    assert buffers.reference is not None and buffers.predicted is not None
    before, after = (np.abs(values - buffers.reference) for values in (buffers.shown, refined.luminance))
    picture, ramp = buffers.picture, settings.colormap
    maximum = settings.heatmap_maximum or chosen.maximum
    below, urgent = picture(buffers.shown), picture(ranking.priority)
    first = picture(ranking.urgency(refined.refined_count))
    gray = {"preview": buffers.preview, "predicted": buffers.predicted, "refined": refined.luminance}
    colors = {"preview": buffers.preview_color, "predicted": buffers.predicted_color, "refined": refined.colors}
    gray["reference"], colors["reference"] = buffers.reference, buffers.reference_color
    looks = {item: gray[item] if color is None else color for item, color in colors.items()}
    return {
        **{item: shown(picture(values)) for item, values in looks.items()},
        "priority": colormap(urgent / np.float32(maximum), ramp),
        "heatmap": heatmap(urgent, maximum, chosen.quantity, map_name=ramp, title=f"{name}: {chosen.name}"),
        "order": tint(below, first),
        "overlay": overlay(below, first, settings.budget_text, title=f"{name}: order of refinement"),
        "error": error_picture(
            picture(before), picture(after), ERROR_MAXIMUM, made.errors, map_name=ramp, unrefined=settings.unrefined
        ),
    }


def overview(views: Sequence[View]) -> np.ndarray:
    """Overview of all cameras in one picture: a row each, from the preview to the reference."""
    columns = ("preview", "predicted", "priority", "order", "refined", "reference")
    rows = [[item.pictures[name] for name in columns] for item in views]
    names = []
    for item in views:
        before, after = item.errors
        names.append(f"{item.camera.name}: mse {before:.5f} -> {after:.5f}")
    titles = ("preview", "predicted", "priority", "refined first: red", "refined", "reference")
    return contact_sheet(rows, names, titles)


def save_view(result: View, folder: Path) -> None:
    """Write the view's pictures into `folder`, a new one."""
    folder.mkdir()
    for name in PICTURES:
        save_png(folder / f"{name}.png", result.pictures[name])
    save_exr(folder / PRIORITY_NAME, result.priority)
