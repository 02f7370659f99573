# SPDX-License-Identifier: GPL-3.0-or-later
"""Values of one pixel of a view in words."""

from __future__ import annotations

from ..codes.coded_octree import CodedOctree
from ..runtime.progress import Steps
from ..tracing.camera import Camera, camera_part
from .registry import strategy
from .trace import trace_view


def pixel_lines(coded: CodedOctree, camera: Camera, ranked_by: str, column: int, row: int) -> Steps[list[str]]:
    """Lines about a pixel of a camera; ranked_by: strategy of its priority, which looks at the pixels around it."""
    chosen = strategy(ranked_by)
    left, low = max(column - 1, 0), max(row - 1, 0)
    wide, high = min(column + 2, camera.width_px) - left, min(row + 2, camera.height_px) - low
    part = camera_part(camera, left, low, wide, high)
    view = yield from trace_view(coded.octree, part, [chosen], coded=coded, reference=False)
    pixel, found = (row - low) * wide + column - left, view.prediction
    if found is None or not view.hit[pixel]:
        return [f"Pixel {column}, {row}", "Level none: background"]
    return [
        f"Pixel {column}, {row}",
        f"Priority {chosen.scores(view)[pixel]:.4g}",
        f"Coverage {found.coverage[pixel]:.3f}" + ("" if found.look_ahead[pixel] else ": no look-ahead"),
        f"Preview luminance {view.preview[pixel]:.4f}",
        f"Luminance of the patch {found.luminance[pixel]:.4f}",
        f"Level {view.hits.level[pixel]}",
    ]
