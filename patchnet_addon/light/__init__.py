# SPDX-License-Identifier: GPL-3.0-or-later
"""Luminance of surfaces: triangle charts, two-light shading, exposure."""
