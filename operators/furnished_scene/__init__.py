# SPDX-License-Identifier: GPL-3.0-or-later
"""Furnished rooms and gardens, composed by script of models from furniture libraries."""

from .compose import INTERIOR, KINDS, Composed, compose_scene
from .save import ENDINGS, save_composed

__all__ = ["ENDINGS", "INTERIOR", "KINDS", "Composed", "compose_scene", "save_composed"]
