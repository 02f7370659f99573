# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles bake of view-independent light on the triangle charts of a surface."""

from .bake import KeptPages, bake_luminance

__all__ = ["KeptPages", "bake_luminance"]
