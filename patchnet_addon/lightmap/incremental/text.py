# SPDX-License-Identifier: GPL-3.0-or-later
"""Sentence about what an incremental bake baked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def incremental_text(provenance: Mapping[str, Any]) -> str:
    """Say what an incremental bake baked, by an octree's provenance; "" where none did."""
    notes = provenance.get("incremental")
    if not notes:
        return ""
    if reason := notes.get("whole_because"):
        return f"All light baked: {reason}"
    if not notes["triangles_baked"]:
        return "No light baked again: nothing changed"
    return f"{notes['texels_baked']:.0%} of the light baked again, {notes['triangles_baked']:,} triangles"
