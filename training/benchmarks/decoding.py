# SPDX-License-Identifier: GPL-3.0-or-later
"""Pixels per second of the whole decoder, in turns with torch's layers alone and the tracer.

Ours is given hits and codes, and interpolates. Torch is given the network's inputs, in chunks that stay in a core's
cache, the best of several sizes and of both orders of an input's values in memory.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.codes.predict import predict
from ...patchnet_addon.network.devices import has_torch
from ...patchnet_addon.network.weights import Weights
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.errors import SettingError
from ...patchnet_addon.runtime.threads import limit_threads
from ...patchnet_addon.tracing.camera import Camera
from ...patchnet_addon.tracing.render import Hits, first_hits
from .timing import Comparison, take_turns

_CHUNKS = (512, 1024, 2048, 4096, 8192, 16384)
_FOV = math.radians(40)
_DISTANCE = 1.9  # of cameras from the cube's centre, in its sides


def benchmark_decoding(coded: CodedOctree, pixels: int, repeats: int, *, threads: int) -> Comparison:
    """Rates over about so many pixels with look-ahead, of pictures from all around the octree; no peer without torch.

    One thread is bound to a core and measured in processor seconds, several in wall seconds. Raises SettingError for an
    octree without look-ahead.
    """
    cameras, hits = views_around(coded, pixels)
    with limit_threads(threads):
        decoded = int(predict(coded, hits).look_ahead.sum())  # compiles, too
        runs: dict[str, Callable[[], Any]] = {
            "decode": lambda: predict(coded, hits),
            "trace": lambda: [first_hits(coded.octree, camera) for camera in cameras],
        }
        peer = _fastest_torch(coded.weights, threads) if has_torch() else None
        if peer is not None:
            runs["torch"] = lambda: peer.run(decoded)
        seconds = take_turns(runs, repeats, all_cores=threads > 1)
    counts = dict.fromkeys(runs, decoded) | {"trace": len(hits.node)}
    rates = {name: counts[name] / median(values) for name, values in seconds.items()}
    details = {
        "pixels_per_s": rates,
        "network": coded.weights.kind.name,
        "threads": threads,
        "clock": "wall" if threads > 1 else "processor",
        "repeats": repeats,
        "pixels": len(hits.node),
        "decoded_pixels": decoded,
        "runs": {name: [round(value, 4) for value in values] for name, values in seconds.items()},
        "torch": peer.name if peer is not None else None,
    }
    theirs = rates.get("torch")
    ratio = rates["decode"] / theirs if theirs is not None else None
    return Comparison("decode", rates["decode"], theirs, ratio, details, unit="pixels per second")


@dataclass(frozen=True, eq=False)
class JoinedHits(Hits):
    """Hits of several cameras as one picture; `ups` (P, 3) float32 is each ray's own, and `camera_up` of the first."""

    ups: np.ndarray

    @property
    def up(self) -> np.ndarray:
        """(P, 3) float32, the picture's up orthogonal to each ray."""
        return self.ups


def views_around(coded: CodedOctree, pixels: int) -> tuple[list[Camera], Hits]:
    """Cameras around an octree, and what all see, as one picture with so many pixels that have look-ahead."""
    cameras: list[Camera] = []
    views: list[Hits] = []
    found = 0
    while found < pixels:
        cameras.append(_camera(coded.octree, coded.weights, len(cameras)))
        views.append(first_hits(coded.octree, cameras[-1]))
        node = views[-1].node
        seen = np.count_nonzero(coded.rows_of(node) >= 0)
        if not seen:
            raise SettingError("From around this octree no pixel has look-ahead: take a deeper one")
        found += seen
    of_pixels = [field.name for field in fields(Hits) if field.name not in ("width_px", "height_px", "camera_up")]
    joined = {name: np.concatenate([getattr(view, name) for view in views]) for name in (*of_pixels, "up")}
    ups = joined.pop("up")
    return cameras, JoinedHits(width_px=len(ups), height_px=1, camera_up=views[0].camera_up, ups=ups, **joined)


def _camera(octree: Octree, weights: Weights, number: int) -> Camera:
    """Camera on a spiral around the cube, with as many pixels as have look-ahead (methods 4.1b)."""
    side = octree.grid.side_world
    height = (0.5 + number * 0.6180339887) % 1 * 1.6 - 0.8
    around = 2.399963 * number
    level = math.sqrt(1 - height * height)
    direction = np.array([level * math.cos(around), level * math.sin(around), height])
    centre = np.asarray(octree.grid.origin_world) + side / 2
    nearest = _DISTANCE - 0.5  # of a ball in the cube
    rows = 4 * math.tan(_FOV / 2) * nearest * 2.0 ** (octree.depth - weights.lookahead)
    size = min(max(int(rows), 2), 2048)
    return Camera.look_at(centre + _DISTANCE * side * direction, centre, fov=_FOV, size_px=(size, size))


class _TorchLayers(NamedTuple):
    """Peer: the layers alone, over ready inputs."""

    name: str
    chunk: int
    apply: Callable[[], Any]

    def run(self, pixels: int) -> None:
        """Decode about so many pixels."""
        import torch

        with torch.no_grad():
            for _ in range(max(round(pixels / self.chunk), 1)):
                self.apply()


def _fastest_torch(weights: Weights, threads: int) -> _TorchLayers:
    """Fastest of several sizes of chunks and both orders of the values, each tried for a moment."""
    import torch

    torch.set_num_threads(threads)
    layers = [(torch.from_numpy(matrix), torch.from_numpy(bias)) for matrix, bias in weights.decoder]
    tried = [
        _TorchLayers(f"torch {torch.__version__}, {chunk} pixels, {order} by {order}", chunk, make(layers, chunk))
        for chunk in _CHUNKS
        for order, make in (("pixel", _by_pixel), ("feature", _by_feature))
    ]
    seconds = take_turns(
        {peer.name: lambda peer=peer: peer.run(100_000) for peer in tried},  # type: ignore[misc]
        5,
        all_cores=threads > 1,
    )
    return min(tried, key=lambda peer: median(seconds[peer.name]) / (round(100_000 / peer.chunk) * peer.chunk))


def _by_pixel(layers: list[Any], chunk: int) -> Callable[[], Any]:
    """Layers over inputs (chunk, 42), or as many as the network has."""
    import torch

    inputs = torch.randn(chunk, layers[0][0].shape[1])

    def apply() -> Any:
        values = inputs
        for matrix, bias in layers[:-1]:
            values = torch.nn.functional.linear(values, matrix, bias).relu_()
        return torch.nn.functional.linear(values, *layers[-1])

    return apply


def _by_feature(layers: list[Any], chunk: int) -> Callable[[], Any]:
    """Layers over inputs (42, chunk), or as many as the network has."""
    import torch

    inputs = torch.randn(layers[0][0].shape[1], chunk)

    def apply() -> Any:
        values = inputs
        for matrix, bias in layers[:-1]:
            values = torch.addmm(bias[:, None], matrix, values).relu_()
        return torch.addmm(layers[-1][1][:, None], layers[-1][0], values)

    return apply
