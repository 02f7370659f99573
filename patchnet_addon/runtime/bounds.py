# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounds of numbers: one table for command-line arguments, Blender properties and settings of scripts.

All bounds are finite. A property whose value 0 means "automatic" has the minimum 0 instead of the row's minimum; the
settings check the row again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .errors import SettingError
from .frames import LAST_FRAME

MAX_DEPTH = 18  # of octrees: pictures of 1920 x 1080 from inside a hall need levels 15 to 18
LOOKAHEADS = (1, 2, 3)  # levels that a network may look ahead (the paper's delta l)
DEFAULT_LOOKAHEAD = 2  # of the shipped weights, and of files that do not say
MOST_STILLS = 4  # cameras of a job; more are a track, whose frames see the same places again
SMALL_PX = 1 << 16  # of a still: up to these, light cells are half as wide, since users magnify it
_PIXEL_SHARE = "give a share of the pixels"
_LARGEST = 1e9  # of factors and of ends of legends
_MAX_PATHS = 65536  # maximum of Cycles' own panel
MAX_SEED = 2**32 - 1
INT32_COUNT = 2**31  # non-negative int32 values
UINT32_COUNT = 2**32
NODE_ADVICE = "choose a smaller depth, or voxelize fewer objects"


@dataclass(frozen=True)
class Bounds:
    """Numbers from `low` to `high`, both inclusive.

    what: the number's name in messages. whole: integers only. advice: ends the error message.
    """

    what: str
    low: float
    high: float
    whole: bool = False
    advice: str = "choose a number in this range"

    def check(self, value: float, what: str = "") -> None:
        """Raise SettingError unless the number is within the bounds; `what` replaces its name in the message."""
        # Blender stores properties and their bounds in single precision: 1e-12 comes back slightly smaller.
        if not min(self.low, _single(self.low)) <= value <= max(self.high, _single(self.high)):
            raise SettingError(f"{what or self.what} {value} is outside {self._range()}: {self.advice}")
        if self.whole and value != int(value):
            raise SettingError(f"{what or self.what} {value} is not a whole number: choose one of {self._range()}")

    def read(self, text: str, what: str = "") -> float:
        """Parse a number, an int where it is whole; raises SettingError as `check`."""
        try:
            value = int(text) if self.whole else float(text)
        except ValueError as cause:
            kind = "whole number" if self.whole else "number"
            raise SettingError(
                f"{what or self.what} {text!r} is not a {kind}: choose one of {self._range()}"
            ) from cause
        self.check(value, what)
        return value

    def _range(self) -> str:
        return f"{_text(self.low)} to {_text(self.high)}"


def _single(value: float) -> float:
    return float(np.float32(value))


def _text(value: float) -> str:
    if value == int(value) and abs(value) < 1e15:
        return str(int(value))
    return f"{value:g}"


# Voxelizing.
DEPTH = Bounds("Depth", 1, MAX_DEPTH, True, "choose a depth in this range")
LEVEL = Bounds("Level", 0, MAX_DEPTH, True, "choose a level in this range")
LOOKAHEAD = Bounds("Look-ahead", LOOKAHEADS[0], LOOKAHEADS[-1], True, "choose how many levels a patch looks ahead")
VOXEL_SIZE = Bounds("Voxel size", 1e-12, 1e12, advice="choose a length in this range")
MEMORY_GIB = Bounds("Memory limit (GiB)", 0.001, 2.0**20, advice="choose as many GiB as the octree may take")
COORDINATE = Bounds("Coordinate", -1e30, 1e30)
SHARE = Bounds("Share", 0, 1)
SHOWN_VOXELS = Bounds("Limit", 1, 2**31 - 1, True)

# Light.
SAMPLES = Bounds("Max samples of baked light", 2, _MAX_PATHS, True)
NOISE_THRESHOLD = Bounds("Noise threshold of baked light", 0.0001, 1)
EXPOSURE = Bounds("Exposure", 1e-9, _LARGEST, advice="choose a factor in this range, or leave it automatic")

# Views.
SIZE_PX = Bounds("Picture size", 0, 16384, True, "choose a number of pixels in this range")
VIEW_PX = Bounds("Picture size", 1, 16384, True, "choose a number of pixels in this range")
BUDGET = Bounds("Budget", 0, 1, advice="give the share of active pixels to refine")
SPP = Bounds("Samples per pixel", 1, 1024, advice="give the mean over the active pixels")
REFINED_SAMPLES = Bounds("Samples per refined pixel", 16, 1024, advice="give the mean over the refined pixels")
HEATMAP_MAXIMUM = Bounds("Heatmap maximum", 1e-9, _LARGEST)
RAYS = Bounds("Rays per pixel side", 1, 32, True)
FRAME = Bounds("Frame", -LAST_FRAME, LAST_FRAME, True)
FRAME_STEP = Bounds("Frame step", 1, LAST_FRAME, True)

# Regions by Cycles, and comparisons with it.
CYCLES_BUDGET = Bounds("Cycles' budget", 0, 1, advice=_PIXEL_SHARE)
CYCLES_SAMPLES = Bounds("Cycles samples", 1, _MAX_PATHS, True)
PLACED_CAMERAS = Bounds("Number of cameras to place", 1, 1000, True, "or give the names of the scene's cameras")
RENDER_SAMPLES = Bounds("Render samples", 2, _MAX_PATHS, True)
DIFFERENCE = Bounds("End of the difference's legend", 1e-9, _LARGEST)

# The cache.
KEPT_GIB = Bounds("Kept octrees (GiB)", 0, 2.0**20)

# Networks, random numbers.
SEED = Bounds("Seed", 0, MAX_SEED, True)
DECODER_WIDTH = Bounds("Decoder width", 6, 78, True, "choose a multiple of 6 in this range")
ENCODER_WIDTH = Bounds("Encoder width", 64, 1024, True, "choose a multiple of 64 in this range")


def check_count(count: int, most: int, what: str, advice: str) -> None:
    """Raise SettingError if `count` exceeds `most`; the message names `what` and ends with `advice`."""
    if count > most:
        bits = 31 if most <= INT32_COUNT else 32
        raise SettingError(f"{count:,} {what} exceed the limit of {bits}-bit indices ({most:,}): {advice}")
