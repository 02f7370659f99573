# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays and decoded pixels per second on a graphics card, in turns with the CPU's kernels, and how equal both are.

The shaders are those of Blender's viewport; EGL runs them where there is no Blender and no window.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import partial
from statistics import geometric_mean
from typing import Any

import numpy as np

from ....commands.shared.views import view_cameras
from ....operators.gpu_view.card_octree import CardOctree, Samples
from ....operators.gpu_view.packing import world_words
from ....operators.gpu_view.shaders import FLOATS, WORDS
from ....patchnet_addon.codes.coded_octree import CodedOctree
from ....patchnet_addon.codes.encode import encode_octree
from ....patchnet_addon.codes.predict import predict
from ....patchnet_addon.image.background import BLACK
from ....patchnet_addon.network.weights import load_weights
from ....patchnet_addon.runtime.progress import drain
from ....patchnet_addon.runtime.threads import limit_threads, usable_cores
from ....patchnet_addon.sampling.registry import STRATEGIES
from ....patchnet_addon.sampling.trace import trace_view
from ....patchnet_addon.tracing.camera import Camera, camera_in_unit_cube
from ....patchnet_addon.tracing.hits import Hits
from ....patchnet_addon.tracing.pixel_filter import BLACKMAN_HARRIS, PixelFilter, rook_places
from ....patchnet_addon.tracing.render import first_hits
from ...benchmarks.timing import comparison, timed
from .decode import camera_around
from .egl_device import EglDevice
from .inputs import given_octree
from .trace import views_of

ESTIMATE_OFF = 1e-3  # of luminance
_AROUND = "Around"  # so far away that all pixels have look-ahead


def measure(args: argparse.Namespace) -> dict[str, Any]:
    """Rates in all views, the geometric mean of rays over that of the CPU's kernels; raises PatchNetError."""
    device = EglDevice()
    octree, name = given_octree(args)
    coded = drain(encode_octree(octree, load_weights(args.weights)))
    cameras = view_cameras(args) if args.view else [*views_of(octree, tuple(args.size)), camera_around(coded, 1)]
    card = CardOctree(device, octree)
    upload_s = _seconds(lambda: [drain(card.upload(octree)), drain(card.upload_codes(coded))], device)
    compile_s = _seconds(lambda: _compile(card, cameras[0]), device)
    threads = args.threads or usable_cores()
    with limit_threads(threads):
        views = [_measured(card, device, coded, camera, args.repeats, threads) for camera in cameras]
    details = {
        "octree": name,
        "depth": octree.depth,
        "nodes": octree.node_count,
        "coded": coded.coded_count,
        "card": device.name,
        "driver": device.version,
        "threads": threads,
        "repeats": args.repeats,
        "card_bytes": card.nbytes,
        "upload_s": upload_s,
        "compile_s": compile_s,
        "views": views,
    }
    ours, peer = (geometric_mean([view[who]["trace"] for view in views]) for who in ("card", "cpu"))
    return comparison("gpu", ours, peer, details, "rays per second")


def _seconds(run: Callable[[], Any], device: EglDevice) -> float:
    start = time.perf_counter()
    run()
    device.finish()
    return time.perf_counter() - start


def _compile(card: CardOctree, camera: Camera) -> None:
    """Compile all shaders, and run them once on a few pixels: some drivers compile when a shader runs first."""
    drain(card.compile("picture", "film", "hits", "decoder", *(("estimate",) if card.estimates else ()), "heat"))
    for work in _works(card, camera.with_size(8, 8))[0].values():
        work()


Work = Callable[[], Any]


def _works(card: CardOctree, camera: Camera) -> tuple[dict[str, Work], tuple[Any, Any, Any]]:
    """Works over a view by name; its images of nodes, of what the decoder writes, and of what the estimator writes."""
    unit, device = camera_in_unit_cube(camera, card.grid), card.device
    hits = card.hit_images(unit)
    decoded, scored, *images = (device.image(camera.width_px, camera.height_px, FLOATS) for _ in range(5))
    words, side = world_words(BLACK)
    samples = Samples.of(device, PixelFilter(BLACKMAN_HARRIS, 1.5), rook_places(1))
    works: dict[str, Work] = {
        "trace": partial(card.trace, unit, hits),
        "decode": partial(card.decode, unit, hits, decoded),
        "color": partial(card.draw, unit, tuple(images), (device.texture(words), side), samples, 0),
    }
    if card.estimates:
        works["estimate"] = partial(card.estimate, unit, hits, decoded, scored)
    return works, (hits.node, decoded, scored)


def _measured(
    card: CardOctree, device: EglDevice, coded: CodedOctree, camera: Camera, repeats: int, threads: int
) -> dict[str, Any]:
    """Rates of the card and of the CPU's kernels in a view, and differences, as plain values."""
    works, images = _works(card, camera)
    runs: dict[str, Work] = {name: partial(_finished, device, work) for name, work in works.items()}
    for run in runs.values():
        run()  # before they are timed
    hits = first_hits(coded.octree, camera)
    predicted = predict(coded, hits)
    node, decoded, scored = map(card.device.read, images, (WORDS, FLOATS, FLOATS))
    equal = compare_with(coded, hits, predicted.look_ahead, node, decoded)
    if card.estimates:
        equal |= compare_estimates(coded, camera, scored)
    runs["cpu_trace"] = partial(first_hits, coded.octree, camera)
    runs["cpu_decode"] = partial(predict, coded, hits)
    seconds, _ = timed(runs, repeats, max(threads, 2))  # wall seconds: a card has no processor's
    pixels, ahead = camera.pixel_count, int(predicted.look_ahead.sum())
    return {
        "name": camera.name if camera.name != "Camera" else _AROUND,
        "size": [camera.width_px, camera.height_px],
        "hit_share": float(hits.hit.mean()),
        "look_ahead_share": ahead / pixels,
        "card": {name: (ahead if name == "decode" else pixels) / seconds[name] for name in works},
        "cpu": {"trace": pixels / seconds["cpu_trace"], "decode": ahead / seconds["cpu_decode"]},
        **equal,
    }


def _finished(device: EglDevice, work: Work) -> None:
    work()
    device.finish()


def compare_with(
    coded: CodedOctree, hits: Hits, look_ahead: np.ndarray, node: np.ndarray, decoded: np.ndarray
) -> dict[str, float | None]:
    """Share of pixels with the CPU's node; of those with look-ahead the largest differences, and correlation of order.

    look_ahead: (P,) bool. node: (H, W) uint32 and decoded: (H, W, 4) float32 as shaders write them.
    """
    found = node.ravel().astype(np.int64)
    found[found == 0xFFFFFFFF] = -1
    same = found == hits.node
    both = same & look_ahead
    equal: dict[str, float | None] = {"same_nodes": float(same.mean())}
    if not both.any():
        return equal | dict.fromkeys(("coverage", "luminance", "order"))
    predicted, ours = predict(coded, hits)[both], decoded.reshape(-1, 4)[both]
    score = np.abs(1 - predicted.coverage) + 5 * np.abs(hits.luminance[both] - predicted.luminance)
    return equal | {
        "coverage": float(np.abs(ours[:, 0] - predicted.coverage).max()),
        "luminance": float(np.abs(ours[:, 1] - predicted.luminance).max()),
        "order": rank_correlation(ours[:, 3], score),
    }


def compare_estimates(coded: CodedOctree, camera: Camera, scored: np.ndarray) -> dict[str, float | None]:
    """Correlation of order and differences of the expected errors of pixels that count.

    scored: (H, W, 4) float32 as the estimator's shader writes it. estimate_off: share of pixels that differ by more
    than ESTIMATE_OFF: those that see another voxel in a pixel around.
    """
    plus = STRATEGIES["patchnet-plus-0"]
    view = drain(trace_view(coded.octree, camera, [plus], coded=coded, reference=False))
    found, expected = scored.reshape(-1, 4)[view.active, 3], plus.scores(view)[view.active]
    off = np.abs(found - expected) > ESTIMATE_OFF
    return {"estimate_order": rank_correlation(found, expected), "estimate_off": float(off.mean())}


def rank_correlation(one: np.ndarray, other: np.ndarray) -> float:
    """Correlation of the places of values (N,) in their order."""
    first, second = (np.argsort(np.argsort(values)).astype(np.float64) for values in (one, other))
    return float(np.corrcoef(first, second)[0, 1]) if len(one) > 1 else 1.0
