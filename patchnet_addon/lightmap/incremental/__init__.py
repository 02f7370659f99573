# SPDX-License-Identifier: GPL-3.0-or-later
"""Incremental bakes: whose light can have changed since the last bake, and the texels of the rest (methods 7.2i)."""
