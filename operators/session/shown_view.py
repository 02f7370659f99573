# SPDX-License-Identifier: GPL-3.0-or-later
"""Arrays of a camera's result for overlay and pixel inspection, without drawing and without the octree."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING
from weakref import ReferenceType, ref

import numpy as np

from ...patchnet_addon.image.colormaps import colormap
from ...patchnet_addon.image.tone import to_bytes
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.sampling.registry import STRATEGIES, strategy
from ...patchnet_addon.sampling.report import shown_figures
from ...patchnet_addon.tracing.camera import Camera
from ..computing.views import ERROR_MAXIMUM
from ..settings.groups import ViewSettings
from .scene_result import Comparison, Row, SceneResult

if TYPE_CHECKING:
    from ..computing.views import View

PREVIEW, PREDICTED, HEATMAP, REFINED, REFERENCE = "PREVIEW", "PREDICTED", "HEATMAP", "REFINED", "REFERENCE"
CYCLES_PICTURE = "CYCLES"  # Refine with Cycles adds it
PREVIEW_ERROR, PREDICTED_ERROR, REFINED_ERROR = "PREVIEW_ERROR", "PREDICTED_ERROR", "REFINED_ERROR"
ERRORS = (PREVIEW_ERROR, PREDICTED_ERROR, REFINED_ERROR)
TITLES = {
    HEATMAP: "Heatmap",
    PREVIEW: "Preview",
    PREDICTED: "Predicted",
    REFINED: "Refined",
    REFERENCE: "Reference",
    CYCLES_PICTURE: "Refined by Cycles",
    PREVIEW_ERROR: "Preview Error",
    PREDICTED_ERROR: "Predicted Error",
    REFINED_ERROR: "Refined Error",
}
# Quantities of a pixel, each with a picture; coverage only with a network.
PRIORITY, COVERAGE, LEVEL = "priority", "coverage", "level"
LUMINANCES = ("preview luminance", "predicted luminance", "refined luminance", "reference luminance")
SAMPLES = "samples"


def attach_view_stats(result: SceneResult, view: View, *, compared: bool = False) -> SceneResult:
    """Add a view's figures to a result, and replace its comparison of strategies."""
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
    """Table of all strategies, measured on a view."""
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


@dataclass(frozen=True, eq=False)
class ShownView:
    """Values of each pixel of a view.

    values: quantity -> (H, W) float32, raw; level is -1 where no surface is.
    looks: PREVIEW, PREDICTED, REFINED, REFERENCE, CYCLES_PICTURE -> (H, W, 3) uint8, sRGB, or (H, W, 4) with alpha if
    there is no background. Without a reference, errors are missing, too. strategy: name.
    maximum: priority at the end of the legend when the view was made. chosen_maximum: the scene's setting then.
    octree: of the view, which may have been freed.
    """

    camera: Camera
    values: dict[str, np.ndarray]
    looks: dict[str, np.ndarray]
    strategy: str
    maximum: float
    chosen_maximum: float
    octree: ReferenceType[Octree]

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height."""
        return self.camera.width_px, self.camera.height_px

    def maximum_now(self, chosen: float) -> float:
        """Priority at the end of the legend for the scene's current setting `chosen` (0: that of the strategy)."""
        return self.maximum if chosen == self.chosen_maximum else chosen or strategy(self.strategy).maximum

    def has(self, name: str) -> bool:
        """Return whether there is the picture, one of TITLES."""
        return name in self.looks or name == HEATMAP or (name in ERRORS and REFERENCE in self.looks)

    def picture(self, name: str, maximum: float, ramp: str) -> np.ndarray:
        """(H, W, 3) float32, or 4, sRGB in [0, 1]: one of TITLES; maximum: of the heatmap; ramp: a colour map."""
        if name in self.looks:
            return self.looks[name].astype(np.float32) / np.float32(255)
        values, end = self.mapped(name, maximum)
        return colormap(values / np.float32(end), ramp)

    def mapped(self, name: str, maximum: float) -> tuple[np.ndarray, float]:
        """Values (H, W) of a colour-mapped picture, and the value at the end of its legend."""
        if name == HEATMAP:
            return self.values[PRIORITY], maximum
        *pictures, reference = (self.values[item] for item in LUMINANCES)
        shown = dict(zip(ERRORS, pictures, strict=True))
        return np.abs(shown[name] - reference), ERROR_MAXIMUM

    def legend(self, name: str, maximum: float) -> tuple[float, str] | None:
        """End of a picture's legend and what it measures; None for pictures that show light."""
        if name in self.looks:
            return None
        if name == HEATMAP:
            return maximum, f"priority: {strategy(self.strategy).quantity}"
        return ERROR_MAXIMUM, "luminance error"

    def describe_pixel(self, column: int, row: int, maximum: float) -> list[str]:
        """Lines about a pixel."""
        value = {name: float(picture[row, column]) for name, picture in self.values.items()}
        level, coverage = round(value[LEVEL]), value.get(COVERAGE)
        return [
            f"Pixel {column}, {row}",
            f"Priority {value[PRIORITY]:.4g} of {maximum:.3g}",
            f"Coverage {'not computed' if coverage is None else format(coverage, '.3f')}",
            *(f"{name.capitalize()} {value[name]:.4f}" for name in LUMINANCES if name in value),
            f"Level {level}" if level >= 0 else "Level none: background",
            f"Samples {round(value[SAMPLES])}",
        ]


def view_to_show(view: View, settings: ViewSettings, chosen_maximum: float) -> ShownView:
    """Arrays for overlay and inspection of a view that was made with `settings`."""
    buffers, refined = view.buffers, view.refined
    assert buffers.predicted is not None
    pictures = buffers.preview, buffers.predicted, refined.luminance, buffers.reference
    flat = {
        LEVEL: np.where(buffers.hit, buffers.hits.level, -1),
        **{name: values for name, values in zip(LUMINANCES, pictures, strict=True) if values is not None},
        SAMPLES: refined.samples,
    }
    known = buffers.prediction or buffers.exact
    if known is not None:
        flat[COVERAGE] = np.where(buffers.hit, known.coverage, 0.0)
    values = {name: np.ascontiguousarray(buffers.picture(item), np.float32) for name, item in flat.items()}
    shown = [name for name in (PREVIEW, PREDICTED, REFINED, REFERENCE) if name.lower() in view.pictures]
    looks = {name: to_bytes(view.pictures[name.lower()]) for name in shown}
    maximum = settings.heatmap_maximum or view.ranking.strategy.maximum
    values[PRIORITY] = view.priority
    return ShownView(view.camera, values, looks, view.strategy, maximum, chosen_maximum, ref(view.octree))
