# SPDX-License-Identifier: GPL-3.0-or-later
"""Learning rates over a run."""

from __future__ import annotations

import math

from ..settings import TrainSettings


def learning_rate(step: int, total: int, settings: TrainSettings) -> float:
    """Learning rate of step `step` of `total`, counted from 0."""
    first, last = settings.learning_rate, settings.final_rate
    if step < settings.warm_up:
        return first * (step + 1) / settings.warm_up
    if settings.schedule == "paper":
        share = step / total
        return first if share < 4 / 8 else math.sqrt(first * last) if share < 7 / 8 else last
    share = (step - settings.warm_up) / max(1, total - settings.warm_up)
    return last + 0.5 * (first - last) * (1 + math.cos(math.pi * min(share, 1.0)))
