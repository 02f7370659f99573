# SPDX-License-Identifier: GPL-3.0-or-later
"""Report of a view's figures, as plain JSON values."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from .errors import mse_at, psnr
from .pixel_buffers import PixelBuffers
from .predicted import PREDICTED
from .ranking import Ranking

ERROR_UNIT = "mean squared error of linear luminance, in which white is 1"  # unit of all errors in JSON files


def shown_errors(report: dict[str, Any]) -> tuple[float, float] | None:
    """Errors of the requested picture in a view's report: unrefined and refined; None without a reference."""
    if not has_errors(report):
        return None
    return float(shown_figures(report)["mse_unrefined"]), float(report["refined"]["mse"])


def has_errors(report: dict[str, Any]) -> bool:
    """Return whether a view's report has errors, which need a reference."""
    return "mse" in report


def shown_figures(report: dict[str, Any]) -> dict[str, Any]:
    """Part of a view's report that holds `mse_unrefined` and `mse` of the shown picture."""
    figures: dict[str, Any] = report["predicted"] if report.get("unrefined") == PREDICTED else report
    return figures


def predicted_report(predicted: PixelBuffers, rankings: Iterable[Ranking]) -> dict[str, Any]:
    """Errors of a view that shows the predicted picture, as `view_report` has those of the preview (methods 3.12b)."""
    unrefined = float(mse_at(predicted, np.zeros(len(predicted.preview)), [0.0])[0])
    return {
        "mse_unrefined": unrefined,
        "psnr_unrefined_db": psnr(unrefined) if unrefined > 0 else None,
        "mse": {ranking.strategy.name: ranking.mse[1] for ranking in rankings},
    }


def view_report(buffers: PixelBuffers, camera_name: str, budget: float, rankings: Iterable[Ranking]) -> dict[str, Any]:
    """Figures of one view; with a reference its errors, unrefined and after `budget` by every strategy (methods 5).

    mse values are over active pixels; refined pixels take the reference; psnr_db is of the unrefined picture.
    """
    report = {
        "camera": camera_name,
        "size": [buffers.width, buffers.height],
        "active_pixels": int(np.count_nonzero(buffers.active)),
        "hit_pixels": int(np.count_nonzero(buffers.hit)),
        "lookahead_share": buffers.lookahead_share,
        "budget": budget,
    }
    if buffers.reference is None:
        return report
    return report | predicted_report(buffers, rankings)
