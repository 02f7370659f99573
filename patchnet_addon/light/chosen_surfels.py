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
    from .seen_cells import SeenCells
    from .sheets import Sheets


class ColoredLeaves(NamedTuple):
    """Surfels (L,) SURFEL of leaves, whose colours are baked, and the grid of their cells."""

    surfels: np.ndarray
    grid: CellGrid


@dataclass(frozen=True, eq=False)
class ChosenSurfels:
    """Surfels (N,) SURFEL with their surface and sheets, what cameras see, and the share of leaves that they do.

    has_baked_color: (M,) bool, materials of which `colored` leaves are baked; None if there are none. glows: (M,) bool,
    those whose base colors are emission.
    """

    surfels: np.ndarray
    surface: SurfelSurface
    grid: CellGrid
    sheets: Sheets
    seen: SeenCells
    nodes: Nodes
    table: TextureTable
    reflects: np.ndarray
    through: np.ndarray
    fine: float
    has_baked_color: np.ndarray
    colored: ColoredLeaves | None
    glows: np.ndarray
