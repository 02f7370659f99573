# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles bake of view-independent light on the surfels of a surface."""

from .bake import EachRound, bake_light
from .bake_job import BakeJob

__all__ = ["BakeJob", "EachRound", "bake_light"]
