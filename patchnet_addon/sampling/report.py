# SPDX-License-Identifier: GPL-3.0-or-later
"""Report of a view's figures, as plain JSON values."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from .errors import mse_at, psnr
from .pixel_buffers import PixelBuffers
from .ranking import Ranking


def refined_mse(report: dict[str, Any], strategy: str) -> float:
    """Error that refinement by the chosen strategy left in a view: of its samples per pixel, if it has them."""
    return float(report["spp"]["mse"] if "spp" in report else report["mse"][strategy])


def view_report(buffers: PixelBuffers, camera_name: str, budget: float, rankings: Iterable[Ranking]) -> dict[str, Any]:
    """Errors of one view, unrefined and after `budget` by every strategy (methods 5). It needs its reference.

    mse values are over active pixels; psnr_db belongs to the unrefined picture.
    """
    unrefined = float(mse_at(buffers, np.zeros(len(buffers.preview)), [0.0])[0])
    return {
        "camera": camera_name,
        "size": [buffers.width, buffers.height],
        "active_pixels": int(np.count_nonzero(buffers.active)),
        "hit_pixels": int(np.count_nonzero(buffers.hit)),
        "lookahead_share": buffers.lookahead_share,
        "budget": budget,
        "mse_unrefined": unrefined,
        "psnr_unrefined_db": psnr(unrefined) if unrefined > 0 else None,
        "mse": {ranking.strategy.name: ranking.mse[1] for ranking in rankings},
    }
