# SPDX-License-Identifier: GPL-3.0-or-later
"""Refine with Cycles beside its rivals: which pixels, how many samples in each, and Cycles for the whole picture.

    python docs/pictures/make_cycles_rivals.py demo [WIDTH HEIGHT [CAMERA,CAMERA]]

prints three tables for each camera and draws cycles-rivals.png, error over processor seconds. The scene is one of the
project's own, or a file that `patchnet run` opens. Needs the extras `blender` and `bench`.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy  # noqa: TID251
import numpy as np
from matplotlib.figure import Figure

from patchnet.__main__ import leave
from patchnet.commands.run import run_with_lines
from patchnet.commands.shared.quiet import quiet_stdout
from patchnet.commands.shared.scene_argument import open_or_build
from patchnet.operators.computing.cycles_pixels import OWN_SIDE, wanted_pixels
from patchnet.operators.cycles.camera_render import add_passes, render_reference
from patchnet.operators.cycles.pixel_renders import Chosen, pixel_renders
from patchnet.operators.cycles.scene_copy import prepared, render
from patchnet.operators.pipeline.cycles_refine import wanted_surface
from patchnet.operators.schema.values import COMBINED
from patchnet.operators.settings.job_settings import JobSettings
from patchnet.patchnet_addon.codes.coded_octree import CodedOctree
from patchnet.patchnet_addon.image.cycles_passes import Reference, combined_light
from patchnet.patchnet_addon.image.exr import read_exr
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.sampling.pixel_buffers import PixelBuffers
from patchnet.patchnet_addon.sampling.ranking import rank
from patchnet.patchnet_addon.sampling.registry import DEFAULT, STRATEGIES
from patchnet.patchnet_addon.sampling.trace import trace_view
from patchnet.patchnet_addon.surface.textures import luminance
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.patchnet_addon.tracing.pixel_filter import EVEN_FOOTPRINT
from patchnet.patchnet_addon.tracing.supersample import supersample
from patchnet.training.benchmarks import markdown_table
from patchnet.training.evaluation.panels import save_figure

SHARES = (0.05, 0.1, 0.2, 0.4)
COMPARED = (DEFAULT, "patchnet-plus-0", "ss-variance", "random")
OPTIMUM = "optimum"
SAMPLES, TRUTH = 32, 512
_SECONDS = (1, 2, 5, 10, 20)  # ticks of the figure
OF_WHOLE = (1, 2, 4, 8, 16, 32)  # samples of Cycles' whole pictures
# Samples by rank, each as shares of the picture and weights; all cost the paths of a fifth of the picture at SAMPLES.
SPREADS = {
    "10 % of the pixels": [(0.1, 1.0)],
    "20 %": [(0.2, 1.0)],
    "40 %": [(0.4, 1.0)],
    "80 %": [(0.8, 1.0)],
    "20 %, 1 : 4 : 16 by rank": [(0.02, 16.0), (0.08, 4.0), (0.1, 1.0)],
    "20 %, 1 : 2 : 4 by rank": [(0.02, 4.0), (0.08, 2.0), (0.1, 1.0)],
    "40 %, 1 : 2 : 4 by rank": [(0.04, 4.0), (0.16, 2.0), (0.2, 1.0)],
}


@dataclass(frozen=True, eq=False)
class Measured:
    """Squared errors (P,) of one camera's pictures: diffuse light of the preview, of the octree's own rays, and of
    Cycles; and what chose pixels: buffers."""

    preview: np.ndarray
    octree: np.ndarray
    cycles: np.ndarray
    buffers: PixelBuffers

    def mask(self, strategy: str, share: float) -> np.ndarray:
        """(P,) bool: the pixels that a strategy chooses, or those of the largest error."""
        if strategy != OPTIMUM:
            ranking = rank(STRATEGIES[strategy], self.buffers, share)
            return ranking.chosen(np.zeros(len(self.preview), bool), share)
        chosen = np.zeros(len(self.preview), bool)
        chosen[np.argsort(-self.preview, kind="stable")[: int(share * len(chosen))]] = True
        return chosen

    def left(self, mask: np.ndarray, others: np.ndarray, noise: float | np.ndarray = 1.0) -> float:
        """Share of the preview's error that is left, with Cycles' times `noise` where `mask` is set."""
        return float(np.where(mask, self.cycles * noise, others).sum() / self.preview.sum())


def main() -> None:
    """Measure all cameras of a scene, print their tables and draw the figure."""
    defaults = ("demo", "320", "240", "all")
    scene, width, height, cameras = (*sys.argv[1:], *defaults[len(sys.argv) - 1 :])
    open_or_build(scene)
    settings = JobSettings.of(cameras=tuple(cameras.split(",")), size=(int(width), int(height)))
    result = run_with_lines(settings)
    curves = {}
    for view in result.views:
        with quiet_stdout():
            measured, truth = _measured(result.coded, view.camera)
            curves[view.camera.name] = _curve(result.coded, view.camera, measured, truth)
        print(f"\n## {view.camera.name}\n\n{_shares_table(measured)}\n\n{_spreads_table(measured)}\n")
        print(_curve_table(curves[view.camera.name]), flush=True)
    if scene == defaults[0]:
        save_figure(_drawn(curves), Path(__file__).with_name("cycles-rivals.png"))
    leave(0)


def _measured(coded: CodedOctree, camera: Camera) -> tuple[Measured, Reference]:
    """What is known of a camera, and Cycles' picture of many samples."""
    chosen = [STRATEGIES[name] for name in COMPARED]
    buffers = drain(trace_view(coded.octree, camera, chosen, coded=coded, reference=False))
    truth = render_reference(bpy.context, camera, TRUTH, 1)
    cycles = _shown(coded, render_reference(bpy.context, camera, SAMPLES, 0).luminance)
    known = _shown(coded, truth.luminance)
    own = drain(supersample(coded.octree, camera, OWN_SIDE, finer=EVEN_FOOTPRINT)).luminance
    errors = ((picture.astype(np.float64) - known) ** 2 for picture in (buffers.preview, own, cycles))
    return Measured(*errors, buffers), truth


def _shown(coded: CodedOctree, light: np.ndarray) -> np.ndarray:
    shown: np.ndarray = np.clip(coded.octree.exposure * light.ravel(), 0.0, 1.0)
    return shown


def _shares_table(measured: Measured) -> str:
    """Error left by the pixels of each strategy, over the preview / over the octree's own rays."""
    rows = []
    for name in (OPTIMUM, *COMPARED):
        masks = [measured.mask(name, share) for share in SHARES]
        pairs = [(measured.left(mask, measured.preview), measured.left(mask, measured.octree)) for mask in masks]
        rows.append([name, *(f"{plain:.3f} / {own:.3f}" for plain, own in pairs)])
    return markdown_table(["error left", *(f"{share:.0%}" for share in SHARES)], rows)


def _spreads_table(measured: Measured) -> str:
    """Error left by as many paths in one share of the pixels or another, even or by rank."""
    rows, paths = [], 0.2 * SAMPLES
    for name, parts in SPREADS.items():
        total, begin = sum(share * weight for share, weight in parts), 0.0
        noise, before = np.ones(len(measured.preview)), np.zeros(len(measured.preview), bool)
        for share, weight in parts:
            begin += share
            mask = measured.mask(DEFAULT, begin)
            noise[mask & ~before] = SAMPLES * total / (weight * paths)
            before = mask
        left = [measured.left(before, others, noise) for others in (measured.preview, measured.octree)]
        samples = ", ".join(f"{weight * paths / total:.3g}" for _, weight in parts)
        rows.append([name, samples, *(f"{value:.3f}" for value in left)])
    return markdown_table(["pixels", "samples", "over the preview", "over the octree's rays"], rows)


def _curve(coded: CodedOctree, camera: Camera, measured: Measured, truth: Reference) -> dict[str, list[Any]]:
    """Rows (label, processor seconds, error of all light) of ways to render all light, reading the scene included."""
    known = _shown(coded, truth.combined)

    def error(picture: np.ndarray) -> float:
        return float(np.mean((_shown(coded, picture) - known) ** 2))

    rows: dict[str, list[Any]] = {"Cycles": [], "Cycles, denoised": [], "Refine with Cycles": []}
    for samples in OF_WHOLE:
        for name, denoised in (("Cycles", False), ("Cycles, denoised", True)):
            begun = time.process_time()
            picture = _whole(camera, samples, denoised)
            rows[name].append((f"{samples}", time.process_time() - begun, error(picture)))
    begun = time.process_time()
    own = drain(supersample(coded.octree, camera, OWN_SIDE, finer=EVEN_FOOTPRINT)).luminance / coded.octree.exposure
    own_s = time.process_time() - begun
    depth = wanted_pixels(wanted_surface(bpy.context.evaluated_depsgraph_get()), camera).depth_world
    for share in SHARES:
        mask = measured.mask(DEFAULT, share)
        begun = time.process_time()
        chosen = Chosen(measured.buffers.picture(mask), depth)
        with pixel_renders(bpy.context, camera, COMBINED, chosen) as cycles:
            pixels = luminance(drain(cycles.picture(SAMPLES, 0, ""))[..., :3]).ravel()
        seconds = time.process_time() - begun + own_s
        rows["Refine with Cycles"].append((f"{share:.0%}", seconds, error(np.where(mask, pixels, own))))
    return rows


def _whole(camera: Camera, samples: int, denoised: bool) -> np.ndarray:
    """Luminance (H, W) of all light of a whole picture."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "whole.exr"
        with prepared(bpy.context, camera, samples, 0, path) as (scene, layer):
            add_passes(layer)
            scene.cycles.use_denoising = denoised
            render(scene, path)
        return luminance(combined_light(read_exr(path)))


def _curve_table(rows: dict[str, list[Any]]) -> str:
    lines = [[name, label, f"{seconds:.1f}", f"{1e4 * error:.1f}"] for name, label, seconds, error in _flat(rows)]
    return markdown_table(["all light", "samples, or share", "processor s", "mse x 10,000"], lines)


def _flat(rows: dict[str, list[Any]]) -> Iterator[tuple[str, str, float, float]]:
    return ((name, *row) for name, points in rows.items() for row in points)


def _drawn(curves: dict[str, dict[str, list[Any]]]) -> Figure:
    figure = Figure(figsize=(4.2 * len(curves), 3.6), dpi=110, layout="constrained")
    for axes, (camera, rows) in zip(figure.subplots(1, len(curves), squeeze=False)[0], curves.items(), strict=True):
        for name, points in rows.items():
            labels, seconds, errors = zip(*points, strict=True)
            axes.plot(seconds, errors, marker="o", label=name)
            for label, x, y in zip(labels, seconds, errors, strict=True):
                axes.annotate(label, (x, y), xytext=(3, 3), textcoords="offset points", fontsize=7)
        axes.set(xscale="log", yscale="log", xlabel="processor seconds", ylabel="mse, all light", title=camera)
        axes.set_xticks(_SECONDS, map(str, _SECONDS), minor=False)
        axes.minorticks_off()
        axes.legend(fontsize=8)
    return figure


if __name__ == "__main__":
    main()
