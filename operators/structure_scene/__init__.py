# SPDX-License-Identifier: GPL-3.0-or-later
"""Procedural structures to train on: bars, slats, meshes, leaves, folds, chequers and text in sizes of voxels."""

from .compose import compose_structures
from .kinds import KINDS

__all__ = ["KINDS", "compose_structures"]
