# SPDX-License-Identifier: GPL-3.0-or-later
"""Split rendering of one view and the first refined pixels of strategies (Fig. 2 of the paper)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import Rectangle

from ....patchnet_addon.codes.coded_octree import CodedOctree
from ....patchnet_addon.image.tone import gray
from ....patchnet_addon.octree.octree import Octree
from ....patchnet_addon.runtime.progress import Progress, Steps
from ....patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ....patchnet_addon.sampling.ranking import Ranking, rank
from ....patchnet_addon.sampling.refine import refined_picture
from ....patchnet_addon.sampling.trace import trace_view
from ....patchnet_addon.tracing.camera import Camera
from ....patchnet_addon.tracing.render import first_hits
from ....patchnet_addon.tracing.supersample import supersample
from ...strategies.registry import EVALUATED
from ..panels import BLUE, ORANGE, PATTERN_BUDGET, Crop, crops_of_difference, pattern, save_panels, show_picture
from ..poses import Surroundings
from ..tracks import Approaches

APPROACHES = 5  # as in a camera track of an evaluation
_FRAMES = 200  # of each
_SIDE = 8  # rays of the pictures that select the view
_LABEL = "Looking for a viewpoint"
PATTERNS = ("patchnet", "patchnet-behind", "ss-variance", "ws-lut", "fine-ray", "optimal")
OURS, OTHER = "patchnet-behind", "ss-variance"  # strategies of the refined pictures
PREVIEW, REFERENCE = "preview", "reference"
_CROPS = 10  # crops in the height of the picture
_MARGIN_PX = 8  # around what is hit
_TITLES = {PREVIEW: "one ray a pixel", REFERENCE: "32 x 32 rays"}
_COLORS = (BLUE, ORANGE)
_INCHES = 11.0
_WIDE = 0.5  # of it for the stripes, the rest for crops


def hardest_end(octree: Octree, size_px: tuple[int, int], lookahead: int) -> Steps[Camera]:
    """Camera at the end of one of five approaches, as near as 95 % of hits have look-ahead.

    The one with the largest squared error of the preview, against 8 x 8 rays per pixel. Raises SceneError if nothing is
    visible.
    """
    yield Progress(0, APPROACHES, _LABEL)
    approaches = Approaches(Surroundings(octree, size_px, lookahead), np.random.default_rng(0))
    ends = []
    for number in range(1, APPROACHES + 1):
        end = approaches.shot(number, APPROACHES, _FRAMES)[-1]
        truth = (yield from supersample(octree, end, _SIDE)).luminance
        ends.append((float(np.sum((first_hits(octree, end).luminance - truth) ** 2.0)), number, end))
        yield Progress(number, APPROACHES, _LABEL)
    return max(ends, key=lambda end: end[:2])[2]


@dataclass(frozen=True, eq=False)
class SplitView:
    """View of N strategies, ranked, and the two crops in which two of them differ most.

    pictures: (H, W) linear luminance of PREVIEW, OURS and OTHER at PATTERN_BUDGET, and REFERENCE.
    """

    camera: Camera
    buffers: PixelBuffers
    rankings: Mapping[str, Ranking]
    pictures: Mapping[str, np.ndarray]
    crops: tuple[Crop, Crop]

    @property
    def bounds(self) -> tuple[slice, slice]:
        """Rows and columns of all hits, with a margin; the whole picture without a hit."""
        hit = self.buffers.picture(self.buffers.hit)
        return _bounds(hit.any(axis=1)), _bounds(hit.any(axis=0))

    def stripes(self) -> np.ndarray:
        """Adjacent stripes (h, w, 3) of `pictures` within `bounds`; together they show the whole view."""
        rows, columns = self.bounds
        shown = [picture[rows, columns] for picture in self.pictures.values()]
        width = shown[0].shape[1]
        which = np.arange(width) * len(shown) // width
        return gray(np.stack(shown)[which, :, np.arange(width)].T)

    def values(self) -> dict[str, Any]:
        """Figures as plain JSON values."""
        before = next(iter(self.rankings.values())).mse[0]
        lefts = {name: ranking.mse[1] for name, ranking in self.rankings.items()}
        return {
            "viewpoint": {
                "name": self.camera.name,
                "position": [float(value) for value in self.camera.position_world],
                "forward": [float(value) for value in self.camera.forward],
                "fov_degrees": float(np.degrees(2 * np.arctan(self.camera.half_y))),
                "size": [self.camera.width_px, self.camera.height_px],
            },
            "budget": PATTERN_BUDGET,
            "look_ahead_share": self.buffers.lookahead_share,
            "active_pixels": int(np.count_nonzero(self.buffers.active)),
            "mse": before,
            "strategies": {name: {"mse": left, "found": found_share(before, left)} for name, left in lefts.items()},
            "crops": [self._crop_values(*which) for which in zip((OURS, OTHER), self.crops, strict=True)],
        }

    def _crop_values(self, better: str, crop: Crop) -> dict[str, Any]:
        rows, columns = crop
        truth = self.pictures[REFERENCE][crop].astype(np.float64)
        shown = {name: picture[crop] for name, picture in self.pictures.items() if name != REFERENCE}
        mse = {name: float(np.mean((picture - truth) ** 2)) for name, picture in shown.items()}
        side = rows.stop - rows.start
        return {"better": better, "row": rows.start, "column": columns.start, "side": side, "mse": mse}


def found_share(before: float, after: float) -> float:
    """Share of the squared error that a budget removes; 1 without error."""
    return 1.0 - after / before if before > 0 else 1.0


def split_view(coded: CodedOctree, camera: Camera) -> Steps[SplitView]:
    """Trace a view, rank its pixels by PATTERNS, and find the crops."""
    chosen = [EVALUATED[name] for name in PATTERNS]
    buffers = yield from trace_view(coded.octree, camera, chosen, coded=coded)
    rankings = {strategy.name: rank(strategy, buffers, PATTERN_BUDGET) for strategy in chosen}
    assert buffers.reference is not None
    refined = {name: refined_picture(buffers, rankings[name].mask) for name in (OURS, OTHER)}
    shown = {PREVIEW: buffers.preview} | refined | {REFERENCE: buffers.reference}
    ours, other = ((refined[name].astype(np.float64) - buffers.reference) ** 2 for name in (OURS, OTHER))
    side = max(min(camera.height_px // _CROPS, camera.width_px // 2), 1)
    crops = crops_of_difference(buffers.picture(ours), buffers.picture(other), side)
    return SplitView(camera, buffers, rankings, {name: buffers.picture(each) for name, each in shown.items()}, crops)


def _bounds(there: np.ndarray) -> slice:
    found = np.flatnonzero(there)
    if not len(found):
        return slice(0, len(there))
    return slice(max(int(found[0]) - _MARGIN_PX, 0), min(int(found[-1]) + 1 + _MARGIN_PX, len(there)))


def draw_split(view: SplitView, folder: Path, name: str, title: str) -> list[Path]:
    """Draw a view; returns the files, raises PatchNetError if one cannot be written."""
    rows, columns = view.bounds
    aspect = (rows.stop - rows.start) / (columns.stop - columns.start)
    wide, small = _WIDE * _INCHES, _INCHES / 3
    heights = (max(wide * aspect + 0.5, 0.3 * _INCHES), 2 * (small * aspect + 0.3))
    figure = Figure(figsize=(_INCHES, sum(heights) + 0.3), dpi=150, layout="constrained")
    figure.suptitle(title, fontsize=11)
    parts: Any = figure.subfigures(2, 1, height_ratios=heights)
    above, below = parts
    left, right = above.subfigures(1, 2, width_ratios=(_WIDE, 1.0 - _WIDE))
    _draw_stripes(left.subplots(), view)
    _draw_crops(right, view)
    for axes, (name_of, ranking) in zip(below.subplots(2, 3).flat, view.rankings.items(), strict=True):
        found = f"{name_of}: {found_share(*ranking.mse):.0%} of the squared error found"
        show_picture(axes, pattern(ranking)[view.bounds], found, interpolation="antialiased")
    return save_panels(figure, folder, name)


def _draw_stripes(axes: Axes, view: SplitView) -> None:
    """Stripes with lines between them and their names below, and frames around the crops."""
    stripes = view.stripes()
    height, width = stripes.shape[:2]
    show_picture(axes, stripes, f"{PATTERN_BUDGET:.0%} of the pixels refined", interpolation="antialiased")
    for number, name in enumerate(view.pictures):
        middle = (number + 0.5) * width / len(view.pictures)
        axes.text(middle, height * 1.01, _TITLES.get(name, name), fontsize=8, ha="center", va="top")
        if number:
            axes.axvline(number * width / len(view.pictures) - 0.5, color="w", lw=0.8)
    rows, columns = view.bounds
    for (crop_rows, crop_columns), color in zip(view.crops, _COLORS, strict=True):
        corner = crop_columns.start - columns.start - 0.5, rows.stop - crop_rows.stop - 0.5
        side = crop_rows.stop - crop_rows.start
        axes.add_patch(Rectangle(corner, side, side, fill=False, ec=color, lw=1.5))


def _draw_crops(figure: SubFigure, view: SplitView) -> None:
    """Crops of all pictures, a row each, in a frame of its colour."""
    rows: Any = figure.subfigures(2, 1)
    for row, crop, color, better, worse in zip(rows, view.crops, _COLORS, (OURS, OTHER), (OTHER, OURS), strict=True):
        row.suptitle(f"where {better} is ahead of {worse} by most", fontsize=9)
        panels = row.subplots(1, len(view.pictures))
        for axes, (name, picture) in zip(panels, view.pictures.items(), strict=True):
            show_picture(axes, gray(picture[crop]), _TITLES.get(name, name))
            axes.title.set_fontsize(8)
            axes.set_axis_on()
            axes.set(xticks=[], yticks=[])
            for spine in axes.spines.values():
                spine.set(color=color, lw=1.5)
