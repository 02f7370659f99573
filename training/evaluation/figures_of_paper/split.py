# SPDX-License-Identifier: GPL-3.0-or-later
"""Split rendering of one view and what strategies refine of it first (Fig. 2 of the paper): what is in the figure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ....patchnet_addon.codes.coded_octree import CodedOctree
from ....patchnet_addon.image.tone import gray
from ....patchnet_addon.runtime.progress import Steps
from ....patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ....patchnet_addon.sampling.ranking import Ranking, rank
from ....patchnet_addon.sampling.refine import refined_picture
from ....patchnet_addon.sampling.trace import trace_view
from ....patchnet_addon.tracing.camera import Camera
from ...strategies.registry import EVALUATED
from ..crops import Crop, crops_of_difference
from ..patterns import PATTERN_BUDGET

PATTERNS = ("patchnet", "patchnet-behind", "ss-variance", "ws-lut", "fine-ray", "optimal")
OURS, OTHER = "patchnet-behind", "ss-variance"  # whose refined pictures are shown beside each other
PREVIEW, REFERENCE = "preview", "reference"
_CROPS = 10  # crops in the height of the picture
_MARGIN_PX = 8  # around what is hit


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
        """Rows and columns of what is hit, with a margin; the whole picture without a hit."""
        hit = self.buffers.picture(self.buffers.hit)
        return _bounds(hit.any(axis=1)), _bounds(hit.any(axis=0))

    def stripes(self) -> np.ndarray:
        """Stripes (h, w, 3) of `pictures` beside each other, within `bounds`; each goes on where the last one ends."""
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
            "viewpoint": _viewpoint(self.camera),
            "budget": PATTERN_BUDGET,
            "look_ahead_share": self.buffers.lookahead_share,
            "active_pixels": int(np.count_nonzero(self.buffers.active)),
            "mse": before,
            "strategies": {name: {"mse": left, "found": found_share(before, left)} for name, left in lefts.items()},
            "crops": [self._crop_values(*which) for which in zip((OURS, OTHER), self.crops, strict=True)],
        }

    def _crop_values(self, better: str, crop: Crop) -> dict[str, Any]:
        truth = self.pictures[REFERENCE][crop.slices].astype(np.float64)
        shown = {name: picture[crop.slices] for name, picture in self.pictures.items() if name != REFERENCE}
        mse = {name: float(np.mean((picture - truth) ** 2)) for name, picture in shown.items()}
        return {"better": better, "row": crop.row, "column": crop.column, "side": crop.side, "mse": mse}


def found_share(before: float, after: float) -> float:
    """Share of the squared error that a budget removes; 1 where there was none."""
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


def _viewpoint(camera: Camera) -> dict[str, Any]:
    return {
        "name": camera.name,
        "position": [float(value) for value in camera.position_world],
        "forward": [float(value) for value in camera.forward],
        "fov_degrees": float(np.degrees(2 * np.arctan(camera.half_y))),
        "size": [camera.width_px, camera.height_px],
    }
