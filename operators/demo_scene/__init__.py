# SPDX-License-Identifier: GPL-3.0-or-later
"""Demo scenes built by script: a courtyard with detail that a coarse view gets wrong, and a closed room."""

from .courtyard import build_courtyard, save_demo_scene, streams
from .room import build_glossy_room, build_room

__all__ = ["build_courtyard", "build_glossy_room", "build_room", "save_demo_scene", "streams"]
