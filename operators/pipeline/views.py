# SPDX-License-Identifier: GPL-3.0-or-later
"""View of a lit and coded octree by one camera: its buffers, its pictures, its figures."""

from __future__ import annotations

from collections.abc import Sequence
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
from ...patchnet_addon.sampling.ranking import Ranking, rank
from ...patchnet_addon.sampling.refine import refinable, refined_colors, refined_picture
from ...patchnet_addon.sampling.registry import STRATEGIES, strategy
from ...patchnet_addon.sampling.report import view_report
from ...patchnet_addon.sampling.strategy import Strategy
from ...patchnet_addon.sampling.trace import trace_view
from ...patchnet_addon.tracing.camera import Camera
from ..importance.pixels import pixel_importance
from ..scene_access.images import ERROR_MAXIMUM, PICTURES, PRIORITY_NAME, save_exr, save_png
from ..settings.groups import ViewSettings


@dataclass(frozen=True, eq=False)
class View:
    """Result of a camera.

    octree: what was looked at. ranking: of its pixels by the chosen strategy, within the budget.
    pictures: name -> (h, w, 3) encoded colours; those of PICTURES, and "priority" and "order", which are the heatmap
    and the overlay without legend. report: figures.
    warnings: why the picture is empty or black, if it is.
    """

    octree: Octree
    camera: Camera
    ranking: Ranking
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
    def priority(self) -> np.ndarray:
        """(H, W) float32: what pixels are ranked by."""
        return self.buffers.picture(self.ranking.priority)


def view(
    coded: CodedOctree, camera: Camera, settings: ViewSettings, scope: str, *, compare: bool, device: str = CPU
) -> Steps[View]:
    """Preview, priority, refinement, reference and errors of one camera.

    scope: which objects were voxelized, for importance that is painted on them. compare: measure all strategies, the
    exact oracles too, not only the chosen one. All of them rank by what the settings' importance makes of their scores.
    device: what decodes, see `predict`. Raises SettingError if what was painted, or the device, is not there.
    """
    chosen = strategy(settings.strategy)
    strategies = list(STRATEGIES.values()) if compare else [chosen, STRATEGIES["optimal"]]
    tracing = run_in_worker(
        lambda: trace_view(coded.octree, camera, strategies, coded=coded, device=device),
        Progress(0, 1, "Tracing the preview"),
    )
    buffers = yield from labelled(tracing, f"{camera.name}: {{}}")
    if settings.importance is not None:
        looked_up = pixel_importance(settings.importance, scope, coded.octree.grid, buffers)
        buffers = replace(buffers, importance=(yield from labelled(looked_up, f"{camera.name}: {{}}")))
    measuring = computed(
        lambda: _measured(coded.octree, buffers, camera, strategies, settings),
        Progress(0, 1, f"{camera.name}: Measuring errors"),
    )
    return (yield from measuring)


def _measured(
    octree: Octree, buffers: PixelBuffers, camera: Camera, strategies: Sequence[Strategy], settings: ViewSettings
) -> View:
    """Figures and pictures of a traced view."""
    from ...patchnet_addon.tracing.unseen import why_unseen

    assert buffers.reference is not None
    unseen = why_unseen(octree, camera, buffers.hits, max(float(buffers.preview.max()), float(buffers.reference.max())))
    rankings = {item.name: rank(item, buffers, settings.budget) for item in strategies}
    report = view_report(buffers, camera.name, settings.budget, rankings.values())
    if settings.importance is not None:
        report["refinable_pixels"] = refinable(buffers)
    chosen = rankings[settings.strategy]
    pictures = _pictures(chosen, settings, camera.name)
    return View(octree, camera, chosen, pictures, report, () if unseen is None else (unseen,))


def _pictures(ranking: Ranking, settings: ViewSettings, name: str) -> dict[str, np.ndarray]:
    """Pictures of a view; those with a legend are magnified, the others are as many pixels as the camera has.

    Preview, refined and reference are in colour if the octree is. The overlay stays gray, so that red means one thing.
    """
    buffers, chosen = ranking.buffers, ranking.strategy
    assert buffers.reference is not None
    refined = refined_picture(buffers, ranking.mask)
    before, after = (np.abs(values - buffers.reference) for values in (buffers.preview, refined))
    picture, ramp = buffers.picture, settings.colormap
    maximum = settings.heatmap_maximum or chosen.maximum
    preview, first, urgent = picture(buffers.preview), picture(ranking.urgency), picture(ranking.priority)
    looks = {"preview": buffers.preview, "refined": refined, "reference": buffers.reference}
    if buffers.preview_color is not None and buffers.reference_color is not None:
        colors = refined_colors(buffers, ranking.mask)
        looks = {"preview": buffers.preview_color, "refined": colors, "reference": buffers.reference_color}
    return {
        "preview": shown(picture(looks["preview"])),
        "priority": colormap(urgent / np.float32(maximum), ramp),
        "heatmap": heatmap(urgent, maximum, chosen.quantity, map_name=ramp, title=f"{name}: {chosen.name}"),
        "order": tint(preview, first),
        "overlay": overlay(preview, first, settings.budget, title=f"{name}: order of refinement"),
        "refined": shown(picture(looks["refined"])),
        "reference": shown(picture(looks["reference"])),
        "error": error_picture(picture(before), picture(after), ERROR_MAXIMUM, ranking.mse, map_name=ramp),
    }


def overview(views: Sequence[View]) -> np.ndarray:
    """Overview of all cameras in one picture: a row each, from the preview to the reference."""
    columns = ("preview", "priority", "order", "refined", "reference")
    rows = [[item.pictures[name] for name in columns] for item in views]
    names = []
    for item in views:
        left = item.report["mse"][item.strategy]
        names.append(f"{item.camera.name}: mse {item.report['mse_unrefined']:.5f} -> {left:.5f}")
    titles = ("preview", "priority", "refined first: red", "refined", "reference")
    return contact_sheet(rows, names, titles)


def save_view(result: View, folder: Path) -> None:
    """Write the view's pictures into `folder`, a new one."""
    folder.mkdir()
    for name in PICTURES:
        save_png(folder / f"{name}.png", result.pictures[name])
    save_exr(folder / PRIORITY_NAME, result.priority)
