# SPDX-License-Identifier: GPL-3.0-or-later
"""Report of a frame's figures, as plain JSON values."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from .errors import mse_at, psnr
from .frame import Frame
from .ranking import Ranking


def frame_report(frame: Frame, camera_name: str, budget: float, rankings: Iterable[Ranking]) -> dict[str, Any]:
    """Errors of one frame, unrefined and after `budget` by every strategy (methods 5). It needs its reference.

    mse values are over active pixels; psnr_db belongs to the unrefined picture.
    """
    unrefined = float(mse_at(frame, np.zeros(len(frame.preview)), [0.0])[0])
    return {
        "camera": camera_name,
        "size": [frame.width, frame.height],
        "active_pixels": int(np.count_nonzero(frame.active)),
        "hit_pixels": int(np.count_nonzero(frame.hit)),
        "lookahead_share": frame.lookahead_share,
        "budget": budget,
        "mse_unrefined": unrefined,
        "psnr_unrefined_db": psnr(unrefined) if unrefined > 0 else None,
        "mse": {ranking.strategy.name: ranking.mse[1] for ranking in rankings},
    }
