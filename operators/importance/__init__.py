# SPDX-License-Identifier: GPL-3.0-or-later
"""What matters to a person in a view, painted as an image or as a vertex group."""

from .painted import Importance
from .pixels import Strokes, importance_key, pixel_importance, read_strokes

__all__ = [
    "Importance",
    "Strokes",
    "importance_key",
    "pixel_importance",
    "read_strokes",
]
