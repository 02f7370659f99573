# SPDX-License-Identifier: GPL-3.0-or-later
"""Squared error of denoised light against the same light with its noise, and both against a bake of many paths.

Errors are of the luminance of texels, by region: smooth light, edges of shadows, contact shadows, textures. All come
from the same paths. The rival is Open Image Denoise, as Blender's compositor has it, on the pages that the texels lie
on, with base colours and normals as guides; once on light from which base colours are divided out, as ours. Bakes of
more paths without denoising say how many of them have the same error.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...patchnet_addon.runtime import bounds
from ..shared.arguments import add_number
from ..shared.job_arguments import require_blender
from .arguments import add_depth

if TYPE_CHECKING:
    from ...patchnet_addon.lightmap.atlas import Atlas
    from ...training.benchmarks.timing import Comparison

HELP = "the error of denoised light against light with its noise, by region"
_UNDENOISED = (8, 16, 32, 64)
_RIVALS = {"Open Image Denoise": False, "Open Image Denoise, without base colors": True}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `patchnet bench denoise`."""
    parser.add_argument("--scene", required=True, help="scene file; demo: the courtyard; room: a closed room")
    add_depth(parser)
    add_number(parser, "--samples", bounds.SAMPLES, default=4, help="paths per texel (4)")
    add_number(parser, "--reference-samples", bounds.SAMPLES, default=1024, help="paths of the reference (1024)")
    add_number(
        parser, "--share", bounds.SHARE, default=1.0,
        help="share of the surface, in random blocks of 16 texels, on which the reference is baked and errors are "
        "measured (1)",
    )  # fmt: skip
    add_number(parser, "--texel-voxels", bounds.TEXEL_VOXELS, default=2.0, help="side of a texel in finest voxels (2)")
    add_number(
        parser, "--undenoised", bounds.SAMPLES, nargs="*", metavar="N", default=_UNDENOISED,
        help="paths per texel of further bakes without denoising, to see which has the error of the denoised one "
        f"({' '.join(map(str, _UNDENOISED))})",
    )  # fmt: skip
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="folder where bakes are left for the next run")


def measure(args: argparse.Namespace) -> Comparison:
    """Errors with and without denoising; raises PatchNetError."""
    require_blender()
    from ...patchnet_addon.lightmap.denoised_atlas import denoised_atlas
    from ...patchnet_addon.runtime.progress import drain
    from ...training.benchmarks.denoising import errors_by_region
    from ..shared.own_scenes import open_or_build
    from ..shared.progress_bars import ProgressBars
    from ..shared.quiet import quiet_stdout
    from .denoise_bakes import bakes_of

    with quiet_stdout(), ProgressBars() as bars:
        open_or_build(args.scene)
        bakes = drain(bakes_of(args), bars.show)
        others = _rivals(bakes.halves, bakes.source) | bakes.more
    start = time.perf_counter()
    denoised = denoised_atlas(bakes.halves, bakes.source)
    seconds = time.perf_counter() - start
    errors = errors_by_region(bakes.plain, denoised, bakes.reference, bakes.source, others)
    return _compared(args, errors, seconds, int(bakes.halves.charts.texel_count))


def _rivals(noisy: Atlas, source: Any) -> dict[str | int, Atlas]:
    """Atlases of other denoisers, by name; none where this Blender has none."""
    from .image_denoiser import image_denoised, is_there

    if not is_there():
        return {}
    return {name: image_denoised(noisy, source, demodulated=without) for name, without in _RIVALS.items()}


def _compared(args: argparse.Namespace, errors: list[Any], seconds: float, texels: int) -> Comparison:
    from ...training.benchmarks.timing import Comparison

    whole = errors[0]
    undenoised = {args.samples: whole.noisy} | {
        key: error for key, error in whole.rivals.items() if isinstance(key, int)
    }
    errors = [replace(each, rivals={k: v for k, v in each.rivals.items() if isinstance(k, str)}) for each in errors]
    details = {
        "scene": Path(args.scene).name,
        "depth": args.depth,
        "samples": args.samples,
        "reference_samples": args.reference_samples,
        "share": args.share,
        "texels": texels,
        "seconds": seconds,
        "regions": [each.as_json() for each in errors],
        "undenoised": undenoised,
        "samples_without": samples_of_error(undenoised, whole.denoised),
    }
    gain = whole.noisy / whole.denoised if whole.denoised else None
    return Comparison("denoise", whole.denoised, whole.noisy, gain, details, unit="mean squared error of luminance")


def samples_of_error(errors: Mapping[int, float], wanted: float) -> float | None:
    """Paths whose bakes have the error `wanted`, by the errors of some numbers of paths; None where none is so small.

    Between two of them errors are taken for a power of the paths.
    """
    known = sorted(errors.items())
    for (few, larger), (many, smaller) in pairwise(known):
        if larger >= wanted >= smaller and larger > smaller > 0.0:
            share = math.log(larger / max(wanted, 1e-30)) / math.log(larger / smaller)
            return float(few * (many / few) ** share)
    return None


def _share(error: float, noisy: float) -> str:
    return f"{error / noisy:.2f}" if noisy > 0 else "-"


def text(values: dict[str, Any]) -> str:
    """Errors by region in a table."""
    from ...training.benchmarks.tables import markdown_table

    rows = [
        [
            each["region"], f"{each['share']:.0%}", f"{each['noisy']:.2e}", f"{each['denoised']:.2e}",
            f"{each['ratio']:.2f}", *(_share(error, each["noisy"]) for error in each["rivals"].values()),
            f"{each['reference_noise']:.1e}",
        ]
        for each in values["regions"]
    ]  # fmt: skip
    rivals = [f"ratio of {name}" for name in values["regions"][0]["rivals"]]
    heads = ["region", "surface", "with noise", "denoised", "ratio", *rivals, "noise of the reference"]
    without = ", ".join(f"{paths} paths {error:.2e}" for paths, error in values["undenoised"].items())
    same = values["samples_without"]
    told = f"the error of the denoised bake takes {same:.0f}" if same else "none has the error of the denoised bake"
    return (
        f"{values['scene']} at depth {values['depth']}, {values['samples']} paths a texel against "
        f"{values['reference_samples']:,}: denoised in {values['seconds']:.1f} s\n\n{markdown_table(heads, rows)}\n\n"
        f"Without denoising, over all: {without}; {told}"
    )
