# SPDX-License-Identifier: GPL-3.0-or-later
"""Optimal strategy, by the true error: the limit of all others (methods 3.1); it needs the reference picture."""

import numpy as np

from .frame import Frame
from .strategy import REFERENCE, Strategy


def _score(frame: Frame) -> np.ndarray:
    assert frame.reference is not None  # `needs` says so
    return np.abs(frame.preview - frame.reference)


STRATEGY = Strategy(
    name="optimal",
    title="Optimal",
    description="The true luminance error, known only from the reference picture: no strategy can do better",
    needs=frozenset({REFERENCE}),
    score=_score,
    quantity="luminance error",
    maximum=0.5,
)
