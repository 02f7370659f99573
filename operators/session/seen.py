# SPDX-License-Identifier: GPL-3.0-or-later
"""View figures as part of the scene's result."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ...patchnet_addon.sampling.registry import STRATEGIES
from ...patchnet_addon.sampling.report import shown_figures
from .scene_result import Comparison, Row, SceneResult

if TYPE_CHECKING:
    from ..pipeline.views import View


def seen(result: SceneResult, view: View, *, compared: bool = False) -> SceneResult:
    """Add a view's figures to a result; a comparison of all strategies if there was one, else none any more."""
    made = replace(
        result,
        lookahead_share=view.buffers.lookahead_share,
        pictures=True,
        comparison=comparison_of(view) if compared else None,
        errors=view.errors,
    )
    made.unmark("view")
    return made


def comparison_of(view: View) -> Comparison:
    """Table of a view on which all strategies were measured."""
    report, figures = view.report, shown_figures(view.report)
    width, height = report["size"]
    rows = [Row(name, STRATEGIES[name].title, error) for name, error in figures["mse"].items()]
    return Comparison(
        view=f"{report['camera']}, {width} x {height}",
        budget=report["budget"],
        unrefined=figures["mse_unrefined"],
        pictures=(("Preview", report["mse_unrefined"]), ("Predicted", report["predicted"]["mse_unrefined"])),
        rows=tuple(sorted(rows, key=lambda row: row.error)),
    )
