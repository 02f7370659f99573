# SPDX-License-Identifier: GPL-3.0-or-later
"""View-independent light from Cycles on the triangle charts of a surface."""

from .bake import bake_luminance

__all__ = ["bake_luminance"]
