# SPDX-License-Identifier: GPL-3.0-or-later
"""Pixel filter of a scene, as Cycles takes it."""

from __future__ import annotations

import bpy

from ...patchnet_addon.tracing.pixel_filter import BLACKMAN_HARRIS, PixelFilter


def pixel_filter_of(scene: bpy.types.Scene) -> PixelFilter:
    """Pixel filter in Cycles' settings; Blackman-Harris with the filter size of EEVEE where Cycles is disabled."""
    cycles = getattr(scene, "cycles", None)
    if cycles is None:
        return PixelFilter(BLACKMAN_HARRIS, max(scene.render.filter_size, 0.01))
    return PixelFilter(cycles.pixel_filter_type, cycles.filter_width)
