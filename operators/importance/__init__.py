# SPDX-License-Identifier: GPL-3.0-or-later
"""What matters to a person in a view, painted as an image or as a vertex group."""

from .painted import IMAGE, NOTHING, VERTEX_GROUP, Importance
from .pixels import importance_key, pixel_importance

__all__ = ["IMAGE", "NOTHING", "VERTEX_GROUP", "Importance", "importance_key", "pixel_importance"]
