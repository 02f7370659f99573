# SPDX-License-Identifier: GPL-3.0-or-later
"""Table (CSV) of all errors of an evaluation, with intervals, PSNR and milliseconds of a frame."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from .bootstrap import finite
from .costs import CYCLES_MS_PER_PIXEL, total_ms
from .curves import psnr

_COLUMNS = (
    "scene", "strategy", "group", "rays_per_pixel", "budget", "mse", "low", "high", "psnr_db", "ms_per_frame",
    "ms_with_rays", "ms_with_cycles",
)  # fmt: skip


def csv_of(results: Mapping[str, Any]) -> str:
    """Table of the results of `results_of`, a line for each scene, strategy and budget.

    After a scene's strategies follow its pictures, unrefined, in the group "picture", without intervals.
    psnr_db: empty where no error is left. ms_per_frame: of the strategy alone; ms_with_rays, ms_with_cycles: with the
    samples that the budget asks for, 32x32 of our own rays a pixel, or CYCLES_MS_PER_PIXEL; empty without a price.
    """
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(_COLUMNS)
    for scene, values in results["scenes"].items():
        for name, curve in values["mse"].items():
            about = (scene, name, values["group"][name], values["rays_per_pixel"][name])
            low, high = (values["intervals"][name][end] for end in ("low", "high"))
            decibels = ["" if finite(value) is None else value for value in psnr(np.asarray(curve)).tolist()]
            columns = zip(values["budgets"], curve, low, high, decibels, *_times(values, name), strict=True)
            rows.writerows((*about, *figures) for figures in columns)
        rows.writerows(_pictures(scene, values))
    return text.getvalue()


def _pictures(scene: str, values: Mapping[str, Any]) -> Iterator[tuple[Any, ...]]:
    """Lines of the uniform and predicted pictures of a scene."""
    uniform = {f"uniform-{side}": picture for side, picture in values["uniform"].items()}
    for name, picture in (uniform | values["predicted"]).items():
        decibels = finite(float(psnr(np.asarray(picture["mse"]))))
        times = [picture["ms_per_frame"]] * 3
        error = picture["mse"], "", "", "" if decibels is None else decibels
        yield scene, name, "picture", picture["rays_per_pixel"], 0.0, *error, *times


def _times(values: Mapping[str, Any], strategy: str) -> tuple[list[Any], list[Any], list[Any]]:
    """Milliseconds at each budget: of the strategy, with own rays, with Cycles; "" without a price."""
    count = len(values["budgets"])
    if strategy not in values["ms_per_frame"]:
        return [""] * count, [""] * count, [""] * count
    own = values.get("ms_by_budget", {}).get(strategy, [values["ms_per_frame"][strategy]] * count)
    prices = values["reference_ms_per_pixel"], CYCLES_MS_PER_PIXEL
    rays, cycles = (total_ms(values, strategy, price).tolist() for price in prices)
    return own, rays, cycles
