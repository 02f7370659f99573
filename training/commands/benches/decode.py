# SPDX-License-Identifier: GPL-3.0-or-later
"""Pixels per second of the whole decoder, in turns with torch's layers alone and the tracer.

PatchNet's decoder reads hits and codes, and interpolates codes. Torch gets the network's inputs, in chunks that fit a
core's cache.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from ....patchnet_addon.codes.coded_octree import CodedOctree
from ....patchnet_addon.codes.encode import encode_octree
from ....patchnet_addon.codes.predict import predict
from ....patchnet_addon.network.devices import has_torch
from ....patchnet_addon.network.weights import Weights, load_weights
from ....patchnet_addon.runtime.errors import SettingError
from ....patchnet_addon.runtime.progress import drain
from ....patchnet_addon.tracing.camera import Camera
from ....patchnet_addon.tracing.hits import Hits
from ....patchnet_addon.tracing.render import first_hits
from ...benchmarks.timing import comparison, timed
from .inputs import given_octree, use_threads

_CHUNK = 4096  # pixels that torch decodes at once
_FOV = math.radians(40)
_DISTANCE = 1.9  # of cameras from the cube's centre, in its sides


def measure(args: argparse.Namespace) -> dict[str, Any]:
    """Rates over pictures from all around an octree; raises PatchNetError, also without look-ahead."""
    (octree, name), weights = given_octree(args), load_weights(args.weights)
    coded = drain(encode_octree(octree, weights))
    cameras: list[Camera] = []  # whose pictures together have so many pixels with look-ahead
    views: list[Hits] = []
    found = 0
    while found < args.pixels:
        cameras.append(camera_around(coded, len(cameras)))
        views.append(first_hits(octree, cameras[-1]))
        seen = int(predict(coded, views[-1]).look_ahead.sum())  # also compiles
        if not seen:
            raise SettingError("No pixel around this octree has look-ahead: give a deeper octree")
        found += seen
    with use_threads(args.threads):
        runs: dict[str, Callable[[], Any]] = {
            "decode": lambda: [predict(coded, hits) for hits in views],
            "trace": lambda: [first_hits(octree, camera) for camera in cameras],
        }
        if has_torch():
            runs["torch"] = partial(_run_layers, weights, found)
        seconds, details = timed(runs, args.repeats, args.threads)
    pixels = sum(camera.pixel_count for camera in cameras)
    rates = {run: (pixels if run == "trace" else found) / each for run, each in seconds.items()}
    details |= {
        "octree": name,
        "nodes": octree.node_count,
        "pixels_per_s": rates,
        "network": weights.kind.name,
        "pixels": pixels,
        "decoded_pixels": found,
    }
    return comparison("decode", rates["decode"], rates.get("torch"), details, "pixels per second")


def camera_around(coded: CodedOctree, number: int) -> Camera:
    """Camera on a spiral around the cube, far enough for as many pixels as possible with look-ahead (methods 4.1b)."""
    octree = coded.octree
    side = octree.grid.side_world
    height = (0.5 + number * 0.6180339887) % 1 * 1.6 - 0.8
    around = 2.399963 * number
    level = math.sqrt(1 - height * height)
    direction = np.array([level * math.cos(around), level * math.sin(around), height])
    centre = np.asarray(octree.grid.origin_world) + side / 2
    nearest = _DISTANCE - 0.5  # of a ball in the cube
    rows = 4 * math.tan(_FOV / 2) * nearest * 2.0 ** (octree.depth - coded.weights.lookahead)
    size = min(max(int(rows), 2), 2048)
    return Camera.look_at(centre + _DISTANCE * side * direction, centre, fov=_FOV, size_px=(size, size))


def _run_layers(weights: Weights, pixels: int) -> None:
    """Run the decoder's layers by torch over inputs (chunk, C), repeatedly up to so many pixels."""
    import torch

    layers = [(torch.from_numpy(matrix), torch.from_numpy(bias)) for matrix, bias in weights.decoder]
    inputs = torch.zeros(_CHUNK, layers[0][0].shape[1])
    with torch.no_grad():
        for _ in range(max(round(pixels / _CHUNK), 1)):
            values = inputs
            for matrix, bias in layers[:-1]:
                values = torch.nn.functional.linear(values, matrix, bias).relu_()
            torch.nn.functional.linear(values, *layers[-1])
