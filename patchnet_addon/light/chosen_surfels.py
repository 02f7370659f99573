# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfels that are chosen for a bake (methods 7.2g)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:  # they bring numba, which nothing imports before it computes
    from ..octree.octree import Nodes
    from ..surface.textures import TextureTable
    from .light_cells import CellGrid, SurfelSurface
    from .sheets import Sheets


class ColoredLeaves(NamedTuple):
    """Surfels (L,) SURFEL of leaves, whose colours are baked, and the grid of their cells."""

    surfels: np.ndarray
    grid: CellGrid


@dataclass(frozen=True, eq=False)
class ChosenSurfels:
    """Surfels (N,) SURFEL with their surface and sheets, and the share of leaves that cameras see.

    colored: leaves of materials with a baked colour; None if there are none. glows: (M,) bool, materials whose base
    colors are emission.
    """

    surfels: np.ndarray
    surface: SurfelSurface
    grid: CellGrid
    sheets: Sheets
    nodes: Nodes
    table: TextureTable
    reflects: np.ndarray
    fine: float
    colored: ColoredLeaves | None
    glows: np.ndarray
