# SPDX-License-Identifier: GPL-3.0-or-later
"""Importance that a user paints for a view, as an image or as a vertex group."""
