# SPDX-License-Identifier: GPL-3.0-or-later
"""Importance that a user paints for a view, as an image or as a vertex group."""

from .painted import Importance
from .pixels import Strokes, importance_key, pixel_importance, read_strokes

__all__ = [
    "Importance",
    "Strokes",
    "importance_key",
    "pixel_importance",
    "read_strokes",
]
