# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounds of numbers of research: training and benchmarks; see `patchnet_addon/runtime/bounds.py`."""

from ..patchnet_addon.runtime.bounds import Bounds

# Training.
DATASET_SAMPLES = Bounds("Samples", 1, 10**12, True)
DATASET_VIEWS = Bounds("Views per voxel", 1, 4096, True)
HELD_OUT = Bounds("Held-out share", 0, 0.99, advice="give a share of each scene")
PASSES = Bounds("Sample passes", 1, 10**15, True)
BATCH = Bounds("Batch", 1, 2**24, True)
FRAME_PIXELS = Bounds("Pixels of a frame", 1, 10**9, True)
CROP = Bounds("Side of crops in pixels", 1, 4096, True)
LEARNING_RATE = Bounds("Learning rate", 1e-9, 10)
LUMINANCE_WEIGHT = Bounds("Luminance weight", 0, 1e6)
STOP_AFTER = Bounds("Steps", 1, 10**15, True)

# Benchmarks.
REPEATS = Bounds("Repeats", 1, 10_000, True)
NODES = Bounds("Nodes", 1, 2**28, True)
THREADS = Bounds("Threads", 1, 1024, True)
TRACK_FRAMES = Bounds("Frames of a track", 1, 10**6, True)
DECODED_PIXELS = Bounds("Decoded pixels", 1, 10**9, True)
