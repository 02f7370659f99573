# SPDX-License-Identifier: GPL-3.0-or-later
"""Arguments of camera tracks, which evaluations look at and sampling maps learn from."""

from __future__ import annotations

import argparse

from ...patchnet_addon.runtime import bounds
from ..shared.arguments import add_number


def add_track(parser: argparse.ArgumentParser, seeds: str = "the camera tracks") -> None:
    """Add --frames, --size and --seed of each scene's track. seeds: what the seed is of."""
    add_number(parser, "--frames", bounds.TRACK_FRAMES, default=2000, help="frames of each scene's track (2000)")
    add_number(
        parser, "--size", bounds.VIEW_PX, nargs=2, default=(130, 130), metavar=("WIDTH", "HEIGHT"),
        help="pixels (130 130)",
    )  # fmt: skip
    add_number(parser, "--seed", bounds.SEED, default=0, help=f"of {seeds} (0)")
