# SPDX-License-Identifier: GPL-3.0-or-later
"""Pixels per second of the whole decoder, in turns with torch's layers alone and the tracer.

Ours is given hits and codes, and interpolates. Torch is given the network's inputs, in chunks that stay in a core's
cache, the best of several sizes and of both orders of an input's values in memory.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.codes.encode import encode_octree
from ...patchnet_addon.codes.predict import predict
from ...patchnet_addon.network.devices import has_torch
from ...patchnet_addon.network.weights import Weights, load_weights
from ...patchnet_addon.runtime.errors import SettingError
from ...patchnet_addon.runtime.progress import drain
from ...patchnet_addon.tracing.camera import Camera
from ...patchnet_addon.tracing.render import first_hits
from ...training.benchmarks.tables import markdown_table
from ...training.benchmarks.timing import Comparison, take_turns, timed
from .inputs import given_octree, use_threads

_CHUNKS = (512, 1024, 2048, 4096, 8192, 16384)
_TRIED = 98_304  # pixels to compare chunks by
_FOV = math.radians(40)
_DISTANCE = 1.9  # of cameras from the cube's centre, in its sides


def measure(args: argparse.Namespace) -> Comparison:
    """Rates over pictures from all around an octree; raises PatchNetError, as for one without look-ahead."""
    (octree, name), weights = given_octree(args), load_weights(args.weights)
    coded = drain(encode_octree(octree, weights))
    cameras = cameras_around(coded, args.pixels)
    views = [first_hits(octree, camera) for camera in cameras]
    with use_threads(args.threads):
        decoded = sum(int(predict(coded, hits).look_ahead.sum()) for hits in views)  # compiles, too
        runs: dict[str, Callable[[], Any]] = {
            "decode": lambda: [predict(coded, hits) for hits in views],
            "trace": lambda: [first_hits(octree, camera) for camera in cameras],
        }
        peer = ""
        if has_torch():
            peer, runs["torch"] = _fastest_torch(weights, decoded, args.threads)
        seconds, details = timed(runs, args.repeats, args.threads)
    pixels = sum(camera.pixel_count for camera in cameras)
    rates = {run: (pixels if run == "trace" else decoded) / each for run, each in seconds.items()}
    details |= {
        "octree": name,
        "nodes": octree.node_count,
        "pixels_per_s": rates,
        "network": weights.kind.name,
        "pixels": pixels,
        "decoded_pixels": decoded,
        "torch": peer or None,
    }
    return Comparison.of_rates("decode", rates["decode"], rates.get("torch"), details, "pixels per second")


def cameras_around(coded: CodedOctree, pixels: int) -> list[Camera]:
    """Cameras around an octree whose pictures together have so many pixels with look-ahead."""
    cameras: list[Camera] = []
    found = 0
    while found < pixels:
        cameras.append(camera_around(coded, len(cameras)))
        seen = np.count_nonzero(coded.rows_of(first_hits(coded.octree, cameras[-1]).node) >= 0)
        if not seen:
            raise SettingError("From around this octree no pixel has look-ahead: take a deeper one")
        found += seen
    return cameras


def camera_around(coded: CodedOctree, number: int) -> Camera:
    """Camera on a spiral around the cube, with as many pixels as have look-ahead (methods 4.1b)."""
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


def _fastest_torch(weights: Weights, pixels: int, threads: int) -> tuple[str, Callable[[], Any]]:
    """Name of the fastest peer, each tried for a moment, and its run over about so many pixels."""
    import torch

    peers = {
        f"torch {torch.__version__}, {chunk} pixels, {order} by {order}": (chunk, order)
        for chunk in _CHUNKS
        for order in ("pixel", "feature")
    }
    tried = {name: partial(_run_layers, weights, *peer, _TRIED) for name, peer in peers.items()}
    seconds = take_turns(tried, 5, threads)
    name = min(peers, key=lambda name: sorted(seconds[name])[2])
    return name, partial(_run_layers, weights, *peers[name], pixels)


def _run_layers(weights: Weights, chunk: int, order: str, pixels: int) -> None:
    """Run the layers over inputs (chunk, C), by feature (C, chunk), as often as so many pixels need."""
    import torch

    layers = [(torch.from_numpy(matrix), torch.from_numpy(bias)) for matrix, bias in weights.decoder]
    columns = layers[0][0].shape[1]
    inputs = torch.zeros((chunk, columns) if order == "pixel" else (columns, chunk))
    with torch.no_grad():
        for _ in range(max(round(pixels / chunk), 1)):
            values = inputs
            for number, (matrix, bias) in enumerate(layers):
                if order == "pixel":
                    values = torch.nn.functional.linear(values, matrix, bias)
                else:
                    values = torch.addmm(bias[:, None], matrix, values)
                if number < len(layers) - 1:
                    values.relu_()


def text(values: dict[str, Any]) -> str:
    """Sentence about the pixels, and a Markdown table of rates."""
    rates = values["pixels_per_s"]
    names = {
        "decode": "ours, whole decode",
        "torch": f"{values['torch']}: layers alone",
        "trace": "tracing the same pixels",
    }
    rows = [[names[run], f"{rates[run]:,.0f}", f"{values['ours'] / rates[run]:.2f}"] for run in names if run in rates]
    return (
        f"{values['octree']}: {values['pixels']:,} pixels, {values['decoded_pixels']:,} of them with look-ahead; "
        f"network: {values['network']}; threads: {values['threads']}, {values['clock']} seconds\n\n"
        f"{markdown_table(['', 'pixels per second', 'ours to that'], rows)}"
    )
