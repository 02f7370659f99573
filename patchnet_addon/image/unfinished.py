# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of views that a job works on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Unfinished:
    """Unfinished picture (h, w, 3) of a camera's view, encoded colours, with a title."""

    camera: str
    title: str
    picture: np.ndarray


Meanwhile = Callable[[Unfinished], None]  # shows a picture at once
