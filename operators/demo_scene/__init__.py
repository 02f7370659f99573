# SPDX-License-Identifier: GPL-3.0-or-later
"""The demo scene: a small courtyard full of things that a coarse view gets wrong, built by script."""

from .courtyard import build_courtyard, save_demo_scene

__all__ = ["build_courtyard", "save_demo_scene"]
