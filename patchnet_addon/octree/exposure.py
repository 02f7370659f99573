# SPDX-License-Identifier: GPL-3.0-or-later
"""Exposure: the luminance that becomes 1 (methods 7.1)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .octree import Octree

QUANTILE = 0.995


def quantile_exposure(leaf_luminance: np.ndarray) -> float:
    """Factor that brings the 99.5 % quantile of leaf luminance (n,) to 1; 1 for a black scene."""
    white = float(np.quantile(leaf_luminance, QUANTILE))
    return 1.0 / white if white > 0 else 1.0


def exposure_text(octree: Octree) -> str:
    """Exposure of an octree in words: the factor, and who chose it."""
    how = {"automatic": " (automatic)", "given": " (given)"}.get(str(octree.provenance.get("exposure")), "")
    return f"Exposure {octree.exposure:.4g}{how}"
