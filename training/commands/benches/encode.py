# SPDX-License-Identifier: GPL-3.0-or-later
"""Codes of a whole octree, from nodes to stored codes, by the compiled encoder against torch, in turns."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from ....patchnet_addon.codes.coded_octree import CodedOctree
from ....patchnet_addon.codes.encode import encode_octree
from ....patchnet_addon.network.devices import CPU, has_torch
from ....patchnet_addon.network.encoders import Encoder
from ....patchnet_addon.network.weights import load_weights
from ....patchnet_addon.runtime.errors import SettingError
from ....patchnet_addon.runtime.progress import drain
from ...benchmarks.timing import comparison, timed
from .inputs import given_octree, use_threads

_REST_SECONDS = 0.3  # torch's threads spin after a product and would occupy cores of the next turn


def measure(args: argparse.Namespace) -> dict[str, Any]:
    """Rates of both, without torch only PatchNet's; raises PatchNetError, also for an octree without look-ahead."""
    (octree, name), weights = given_octree(args), load_weights(args.weights)

    def encoded(encoder: Encoder | None = None) -> CodedOctree:
        return drain(encode_octree(octree, weights, encoder=encoder))

    runs: dict[str, Callable[[], CodedOctree]] = {"compiled": encoded}
    if has_torch():
        from ....patchnet_addon.network.torch_encode import TorchEncoder

        runs["torch"] = partial(encoded, TorchEncoder(weights, CPU))
    with use_threads(args.threads):
        codes = [run().codes.astype(np.float32) for run in runs.values()]  # also compiles
        if not len(codes[0]):
            raise SettingError("This octree has no corners to encode: give one of depth 2 or more")
        seconds, details = timed(runs, args.repeats, args.threads, prepare=partial(time.sleep, _REST_SECONDS))
    rates = {backend: len(codes[0]) / each for backend, each in seconds.items()}
    details |= {
        "octree": name,
        "nodes": octree.node_count,
        "corners": len(codes[0]),
        "corners_per_s": rates,
        "largest_difference": float(np.abs(codes[-1] - codes[0]).max()),
        "largest_code": float(np.abs(codes[0]).max()),
    }
    return comparison("encode", rates["compiled"], rates.get("torch"), details, "corners per second")
