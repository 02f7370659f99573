# SPDX-License-Identifier: GPL-3.0-or-later
"""Tables of an evaluation's results as pandas frames: all errors, and excerpts for documentation and reports."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from statistics import median
from typing import Any

import numpy as np
import pandas as pd

from ..benchmarks import markdown_table
from .costs import CYCLES_MS_PER_PIXEL, total_ms
from .results import POOLED, VARIANCE
from .strategies import network_name

TITLE = "# Tables of an evaluation"
BUDGET = 30  # percent
BUDGETS = 5, 10, 20, 30, 50, 70  # of means over scenes, and of pairs
_LEAST = 1e-9  # of a ratio, for its logarithm
_RATIOS = (
    "patchnet-plus-0", "plain-plus-0", "patchnet", "patchnet-plus-1", "plain-plus-1", "patchnet-behind", "fusion",
    "fine-ray", "fine-ray-variance", "patchnet-plus", "plain-plus-4", "fine-rays-4", "fine-rays-4-variance",
)  # fmt: skip
PAIRS = {
    "patchnet-plus-0": ("patchnet", VARIANCE, "ss-variance-hits", "plain-plus-0"),
    "patchnet-plus-1": ("fine-ray", "fine-ray-variance", "patchnet-behind", "fusion", "plain-plus-1"),
    "patchnet-plus": ("fine-rays-4", "fine-rays-4-variance", "plain-plus-4"),
}  # strategies and their rivals at as many rays
_CYCLES_SHOWN = (
    VARIANCE, "patchnet-plus-0", "patchnet", "patchnet-plus-1", "patchnet-behind", "fusion",
    "fine-ray", "fine-ray-variance", "patchnet-plus", "fine-rays-4", "optimal",
)  # fmt: skip
Tables = list[tuple[str, pd.DataFrame]]
"""Titles and tables of text cells."""


def markdown_of(tables: Tables) -> str:
    """Markdown of tables."""
    parts = [TITLE]
    for title, table in tables:
        parts += [title, markdown_table(list(table.columns), table.itertuples(index=False))]
    return "\n\n".join(parts) + "\n"


def tables_of(results: Mapping[str, Any]) -> Tables:
    """Tables of the results of `results_of`: scenes, errors, strategies by rays, claims, pictures, picture metrics."""
    scenes, claims = results["scenes"], results["claims"]
    first = next(iter(scenes.values()))
    names = sorted(
        (name for name in first["mse"] if network_name(name) is None and name not in ("random", VARIANCE)),
        key=lambda name: (first["group"][name] == "oracle", first["rays_per_pixel"][name], name),
    )
    shown = [VARIANCE, *names]
    pooled = {"pooled": results["pooled"]} if "pooled" in results else {}
    return [
        ("Scenes; mean squared errors times 10,000.", _scenes(scenes)),
        (f"Error at {BUDGET}% over that of `{VARIANCE}`.",
         _by_strategy(variance_ratios(scenes | pooled, BUDGET).loc[names])),
        (f"Strategies by further rays: geometric mean over scenes of the error over that of `{VARIANCE}`, by budget; "
         "excess area from the best scene to the worst; milliseconds of a frame on one thread, median over scenes.",
         over_scenes(scenes, shown)),
        (f"Scenes of {len(scenes)} in which one strategy leaves less than another, by budget, and the largest ratio of "
         "both errors: at equal budgets, and in equal time where samples are own rays, or those of Cycles.",
         _ahead(scenes)),
        (f"Intervals of 95 % of the ratio to `{VARIANCE}` at {BUDGET}%.",
         _by_scene(claims["half"], _RATIOS, _half).replace(POOLED, "pooled")),
        ("Lowest of the paper's references: from which budget on (interval), at which share of budgets from 13 % on.",
         _by_scene(claims["lowest"], shipped(claims["lowest"][next(iter(scenes))]), _from)),
        ("Rays in each pixel, and what the network predicts: error times 10,000, and milliseconds.", _pictures(scenes)),
        (f"Picture metrics at {BUDGET}%, means over scenes.",
         _quality([values["quality"] for values in scenes.values()])),
    ]  # fmt: skip


def shipped(found: Mapping[str, Any]) -> dict[str, Any]:
    """Results of strategies without further networks, which are in the matrix of generalisation."""
    return {name: values for name, values in found.items() if network_name(name) is None}


def cycles_tables(scenes: Mapping[str, Any]) -> Tables:
    """Tables of scenes by name, as `cycles_results` gives each: errors against Cycles, and which are ahead."""
    truths = {name: values["truths"]["diffuse"] for name, values in scenes.items()}
    mse = 1e4 * _mse(truths, BUDGET)
    errors = pd.DataFrame(
        {
            "scene": list(truths),
            "bias": [f"{1e4 * values['bias']:.1f}" for values in truths.values()],
            "noise": [f"{1e4 * values['noise']:.2f}" for values in truths.values()],
            "unrefined": [f"{1e4 * values['mse']['random'][0]:.1f}" for values in truths.values()],
        }
        | {f"`{name}`": mse.loc[name].map("{:.1f}".format).tolist() for name in _CYCLES_SHOWN if name in mse.index}
    )
    return [
        (f"Mean squared error times 10,000 against Cycles' diffuse light and emission, at {BUDGET}%. The bias is "
         "that of rays of the octree, the noise that of the render.", errors),
        (f"Scenes of {len(truths)} in which one strategy leaves less than another, by budget, and the largest ratio "
         "of both errors.", _ahead(truths).drop(columns="at equal")),
    ]  # fmt: skip


def _mse(scenes: Mapping[str, Any], at: int) -> pd.DataFrame:
    """Errors of strategies (rows) in scenes at a budget in percent."""
    curves = {scene: values["mse"].items() for scene, values in scenes.items()}
    return pd.DataFrame({scene: {name: curve[at] for name, curve in found} for scene, found in curves.items()})


def variance_ratios(scenes: Mapping[str, Any], at: int) -> pd.DataFrame:
    """Errors of strategies in scenes over those of the variance, at a budget in percent; NaN where it leaves none."""
    mse = _mse(scenes, at)
    return mse / mse.loc[VARIANCE].where(mse.loc[VARIANCE] > 0)


def _by_strategy(frame: pd.DataFrame, form: str = "{:.2f}") -> pd.DataFrame:
    """Numbers as text, with the strategies as first column."""
    cells = frame.map(lambda value: "" if pd.isna(value) else form.format(value))
    cells.insert(0, "strategy", [f"`{name}`" for name in frame.index])
    return cells


def _by_scene(found: Mapping[str, Any], columns: Iterable[str], cell: Callable[[Any], str]) -> pd.DataFrame:
    """Results by scene and column as text, for the columns that all scenes have."""
    there = [name for name in columns if all(name in values for values in found.values())]
    rows = {row: [cell(values[name]) for name in there] for row, values in found.items()}
    quoted = [f"`{name}`" for name in there]
    return pd.DataFrame.from_dict(rows, orient="index", columns=quoted).rename_axis("scene").reset_index()


def error_ratios(scenes: Mapping[str, Any], strategy: str, rival: str, price: str | None) -> np.ndarray:
    """Error of a strategy over that of a rival, (scenes, budgets) at BUDGETS.

    price: cost of a refined pixel's samples, "own" rays or "cycles"; the rival then has the budget of the same total
    time (`total_ms`). None: both have the same budget. 1 if both errors are 0, infinite if only the rival's is.
    """
    ratios = []
    for values in scenes.values():
        left, theirs = (np.asarray(values["mse"][name]) for name in (strategy, rival))
        if price is not None:
            ms = CYCLES_MS_PER_PIXEL if price == "cycles" else values["reference_ms_per_pixel"]
            theirs = np.interp(total_ms(values, strategy, ms), total_ms(values, rival, ms), theirs)
        left, theirs = left[list(BUDGETS)], theirs[list(BUDGETS)]
        with np.errstate(divide="ignore", invalid="ignore"):
            ratios.append(np.where(left == theirs, 1.0, left / theirs))
    return np.array(ratios)


def _ahead(scenes: Mapping[str, Any]) -> pd.DataFrame:
    """Scenes in which a strategy is ahead of a rival; also at equal time if times are known."""
    first = next(iter(scenes.values()))
    known = first.get("ms_per_frame", first["mse"]).keys()
    prices = {"budget": None} | ({"time, own rays": "own", "time, Cycles": "cycles"} if "ms_per_frame" in first else {})
    rows = []
    for ours, rivals in PAIRS.items():
        for rival in rivals:
            for title, price in prices.items() if {ours, rival} <= known else ():
                ratios = error_ratios(scenes, ours, rival, price)
                counts = zip((ratios < 1).sum(axis=0), ratios.max(axis=0), strict=True)
                rows.append([f"`{ours}`", f"`{rival}`", title, *(f"{count} ({most:.3f})" for count, most in counts)])
    return pd.DataFrame(rows, columns=["strategy", "rival", "at equal", *(f"{at}%" for at in BUDGETS)])


def geometric_means(ratios: pd.DataFrame) -> pd.Series:
    """Geometric mean over scenes (columns) of each row."""
    return np.exp(np.log(ratios.clip(lower=_LEAST)).mean(axis=1))


def over_scenes(scenes: Mapping[str, Any], names: Sequence[str]) -> pd.DataFrame:
    """Strategies over all scenes as text, grouped by rays, oracles last."""
    first, areas = next(iter(scenes.values())), excess_areas(scenes, names)
    means = pd.DataFrame({f"{at}%": geometric_means(variance_ratios(scenes, at)) for at in BUDGETS}).loc[areas.index]
    table = _by_strategy(means.map(lambda mean: f"{mean:.2f}" if mean >= 0.1 else f"{mean:.3f}"), "{}")
    ends = zip(areas.min(axis=1), areas.max(axis=1), strict=True)
    table["excess area"] = [f"{least:.3f} to {most:.3f}" for least, most in ends]
    oracle = [first["group"][name] == "oracle" for name in names]
    times = [[values["ms_per_frame"].get(name) for values in scenes.values()] for name in names]
    table["ms"] = ["" if no or None in each else f"{median(each):.1f}" for no, each in zip(oracle, times, strict=True)]
    rays = [first["rays_per_pixel"][name] - 1 for name in names]
    table.insert(0, "further rays", ["oracle" if no else str(each) for no, each in zip(oracle, rays, strict=True)])
    return table


def _scenes(scenes: Mapping[str, Any]) -> pd.DataFrame:
    return pd.DataFrame(
        {
            "scene": scene,
            "depth": str(values["depth"]),
            "nodes": f"{values['nodes']:,}",
            "frames": str(values["frames"]),
            "look-ahead": f"{values['lookahead_share']:.1%}",
            "unrefined": f"{1e4 * values['mse']['random'][0]:.1f}",
            f"`{VARIANCE}`, {BUDGET}%": f"{1e4 * values['mse'][VARIANCE][BUDGET]:.1f}",
            "optimal": f"{1e4 * values['mse']['optimal'][BUDGET]:.1f}",
        }
        for scene, values in scenes.items()
    )


def excess_areas(scenes: Mapping[str, Any], names: Sequence[str]) -> pd.DataFrame:
    """Excess areas of strategies (rows) in scenes; NaN without error."""
    areas = {scene: values["excess_area"] for scene, values in scenes.items()}
    return pd.DataFrame({scene: {name: each[name] for name in names} for scene, each in areas.items()}, dtype=float)


def _half(values: Mapping[str, Any]) -> str:
    """Ratio to the variance, and its interval; empty where the variance leaves no error."""
    found = [values[name] for name in ("value", "low", "high")]
    return "" if None in found else "{:.2f} ({:.2f} to {:.2f})".format(*found)


def _from(values: Mapping[str, Any]) -> str:
    """Budget from which a strategy is lowest, its interval, and the share of budgets."""
    share = f"{values['share_of_budgets']:.0%}"
    if values["value"] is None:
        return f"never for good; {share}"
    high = "never" if values["high"] is None else f"{values['high']:.0%}"
    return f"{values['value']:.0%} ({values['low']:.0%} to {high}); {share}"


def _pictures(scenes: Mapping[str, Any]) -> pd.DataFrame:
    return pd.DataFrame(
        {"scene": scene}
        | {
            name: f"{1e4 * picture['mse']:.1f} in {picture['ms_per_frame']:.1f} ms"
            for name, picture in (
                *((f"{side} x {side}", picture) for side, picture in values["uniform"].items()),
                *((f"`{name}`", picture) for name, picture in values["predicted"].items()),
            )
        }
        for scene, values in scenes.items()
    )


def _quality(found: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """Means over scenes of each metric that was computed for all of them."""
    means = {
        metric: pd.DataFrame([quality[metric] for quality in found], dtype=float).mean(skipna=False)
        for metric in found[0]
    }
    return _by_strategy(pd.DataFrame(means).dropna(axis=1, how="any"), "{:.4f}")
