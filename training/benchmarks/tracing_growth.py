# SPDX-License-Identifier: GPL-3.0-or-later
"""Growth of the tracer's rate with threads, with the size of the picture and with the depth of the octree."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.threads import limit_threads, usable_cores
from ...patchnet_addon.tracing.camera import Camera
from ...patchnet_addon.tracing.render import trace_pixels
from .figures import BLUE, GREEN, ORANGE, PURPLE, finish, plain_numbers, save_figure
from .timing import take_turns
from .whole_scene import cut

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Rates = dict[str, dict[str, list[float]]]
_WIDTHS = (240, 480, 960, 1920, 3840)
_SHALLOWEST = 5
_LEAST_PIXELS = 500_000  # traced for a time: smaller pictures are traced several times


def measure_growth(octree: Octree, cameras: Sequence[Camera], repeats: int, threads: int) -> Rates:
    """Rays per second of first hits, wall seconds: for threads, width_px and depth, x and for each view the rates.

    threads: with which pictures of other sizes and octrees of other depths are traced.
    """
    cores = usable_cores()
    counts = sorted({cores, *(1 << power for power in range(cores.bit_length()))} & set(range(1, cores + 1)))
    depths = range(min(_SHALLOWEST, octree.depth), octree.depth + 1)
    shallow = {depth: cut(octree, depth) for depth in depths}
    rates: Rates = {
        "threads": {"x": list(map(float, counts))},
        "width_px": {"x": list(map(float, _WIDTHS))},
        "depth": {"x": list(map(float, depths))},
    }
    for camera in cameras:
        wide = [_wide(camera, width) for width in _WIDTHS]
        views = {
            "threads": [(octree, camera, count) for count in counts],
            "width_px": [(octree, view, threads) for view in wide],
            "depth": [(shallow[depth], camera, threads) for depth in depths],
        }
        for name, traced in views.items():
            rates[name][camera.name] = _rates(traced, repeats)
    return rates


def _wide(camera: Camera, width: int) -> Camera:
    """Return the camera with a picture of another size, of the same shape up to a pixel."""
    return replace(camera, width_px=width, height_px=max(round(width * camera.height_px / camera.width_px), 1))


def _rates(traced: Sequence[tuple[Octree, Camera, int]], repeats: int) -> list[float]:
    """Rays per second of octrees, cameras and numbers of threads, which take turns."""
    pictures = [max(_LEAST_PIXELS // camera.pixel_count, 1) for _, camera, _ in traced]

    def run(octree: Octree, camera: Camera, threads: int, count: int) -> None:
        with limit_threads(threads):
            for _ in range(count):
                trace_pixels(octree, camera)

    runs: dict[str, Callable[[], object]] = {
        str(index): partial(run, *view, count) for index, (view, count) in enumerate(zip(traced, pictures, strict=True))
    }
    seconds = take_turns(runs, repeats, all_cores=True)
    return [
        count * view[1].pixel_count / median(times)
        for view, count, times in zip(traced, pictures, seconds.values(), strict=True)
    ]


def draw_growth(rates: Rates, path: Path, title: str) -> None:
    """Draw a figure of three diagrams, 1100 pixels wide; raises PatchNetError if it cannot be written."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 3.8), dpi=100, layout="constrained")
    figure.suptitle(title, fontsize=12)
    labels = {"threads": "threads", "width_px": "width of the picture (pixels)", "depth": "depth of the octree"}
    for axes, (name, label) in zip(figure.subplots(1, 3), labels.items(), strict=True):
        _draw(axes, rates[name], label, logarithmic=name == "width_px")
    save_figure(figure, path)


def _draw(axes: Axes, rates: dict[str, list[float]], label: str, *, logarithmic: bool) -> None:
    colors: Iterable[str] = (BLUE, ORANGE, GREEN, PURPLE)
    views = {name: values for name, values in rates.items() if name != "x"}
    for (name, values), color in zip(views.items(), colors, strict=False):
        axes.plot(rates["x"], [rate / 1e6 for rate in values], "o-", color=color, ms=5, label=name)
    axes.set(xlabel=label, ylabel="million rays per second")
    axes.set_ylim(bottom=0)
    if logarithmic:
        axes.set(xscale="log", xticks=rates["x"])
        plain_numbers(axes.xaxis)
        axes.set_xticks(rates["x"])
    else:
        axes.set_xticks(rates["x"])
    finish(axes)
