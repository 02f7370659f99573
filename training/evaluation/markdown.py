# SPDX-License-Identifier: GPL-3.0-or-later
"""Markdown tables of an evaluation's results, with a column for each scene, as documentation shows them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from statistics import median
from typing import Any

from ..benchmarks.tables import markdown_table
from .claims import VARIANCE
from .over_scenes import BUDGETS, error_ratios, geometric_means, scenes_ahead
from .patch_networks import network_name
from .results import POOLED

TITLE = "# Tables of an evaluation"
BUDGET = 0.3
BUDGETS_SHOWN = (0.1, 0.13, 0.2, 0.3, 0.5, 0.7)
_RATIOS = (
    "patchnet-plus-0", "plain-plus-0", "patchnet", "patchnet-plus-1", "plain-plus-1", "patchnet-behind", "fusion",
    "fine-ray", "fine-ray-variance", "patchnet-plus", "plain-plus-4", "fine-rays-4", "fine-rays-4-variance",
)  # fmt: skip


PAIRS = {
    "patchnet-plus-0": ("patchnet", VARIANCE, "ss-variance-hits", "plain-plus-0"),
    "patchnet-plus-1": ("fine-ray", "fine-ray-variance", "patchnet-behind", "fusion", "plain-plus-1"),
    "patchnet-plus": ("fine-rays-4", "fine-rays-4-variance", "plain-plus-4"),
    "patchnet-plus-1-staged": ("fine-ray", "fine-ray-variance", "patchnet-behind", "fusion", "plain-plus-1-staged"),
    "patchnet-plus-staged": ("fine-rays-4", "fine-rays-4-variance", "plain-plus-4-staged"),
}  # strategies and their rivals at as many rays


def markdown_of(results: Mapping[str, Any]) -> str:
    """Tables of the results of `results_of`: scenes, errors, excess areas, costs, claims, matrix, picture metrics."""
    scenes, claims = results["scenes"], results["claims"]
    first = next(iter(scenes.values()))
    names = sorted(
        (name for name in first["mse"] if network_name(name) is None and name not in ("random", VARIANCE)),
        key=lambda name: (first["group"][name] == "oracle", first["rays_per_pixel"][name], name),
    )
    areas = {scene: _areas(values) for scene, values in scenes.items()}
    parts = [
        TITLE,
        "Scenes; mean squared errors times 10,000.",
        _scenes(scenes),
        f"Error at {BUDGET:.0%} over that of `{VARIANCE}`.",
        _by_scene(results, names, _over_variance),
        *_pooled(results, names),
        f"Strategies by further rays: geometric mean over scenes of the error over that of `{VARIANCE}`, by budget; "
        "excess area from the best scene to the worst; milliseconds of a frame on one thread, median over scenes.",
        _over_all(scenes, [VARIANCE, *names]),
        f"Scenes of {len(scenes)} in which one strategy leaves less than another, by budget, and the largest ratio of "
        "both errors: at equal budgets, and in equal time where samples are own rays, or those of Cycles.",
        _ahead(scenes),
        "Excess area: 0 is optimal, 1 is random.",
        markdown_table(
            ["strategy", *scenes],
            ([f"`{name}`", *(f"{areas[scene][name]:.3f}" for scene in scenes)] for name in [VARIANCE, *names]),
        ),
        "Cost: rays a pixel, and milliseconds of a frame on one thread, median over scenes and by scene.",
        _costs(scenes, names),
        f"Intervals of 95 % of the ratio to `{VARIANCE}` at {BUDGET:.0%}.",
        _intervals(claims["half"]),
        "Lowest of the paper's references: from which budget on (interval), at which share of budgets from 13 % on.",
        _lowest(claims["lowest"]),
        "Rays in each pixel, and what the network predicts: error times 10,000, and milliseconds.",
        _pictures(scenes),
        f"Predicted pictures refined by their own priority: error over that of `{VARIANCE}` from the preview.",
        _predicted(scenes),
        f"Picture metrics at {BUDGET:.0%}, means over scenes.",
        _quality([values["quality"] for values in scenes.values()]),
    ]
    for score, found in claims.get("generalisation", {}).items():
        parts += [
            f"Generalisation of `{score}`, error at {BUDGET:.0%} over that of `{VARIANCE}`.",
            _matrix(found, scenes),
        ]
    return "\n\n".join(parts) + "\n"


def _ahead(scenes: Mapping[str, Any]) -> str:
    first = next(iter(scenes.values()))
    return markdown_table(
        ["strategy", "rival", "at equal", *(f"{budget}%" for budget in BUDGETS)],
        (
            [f"`{ours}`", f"`{rival}`", title, *counts_ahead(scenes, ours, rival, price)]
            for ours, rivals in PAIRS.items()
            for rival in rivals
            if {ours, rival} <= first["ms_per_frame"].keys()
            for title, price in (("budget", None), ("time, own rays", "own"), ("time, Cycles", "cycles"))
        ),
    )


def counts_ahead(scenes: Mapping[str, Any], ours: str, rival: str, price: str | None) -> list[str]:
    """Scenes in which one is ahead of the other, and the largest ratio of their errors, at BUDGETS."""
    counts = scenes_ahead(scenes, ours, rival, price)
    largest = error_ratios(scenes, ours, rival, price).max(axis=0)
    return [f"{count} ({ratio:.3f})" for count, ratio in zip(counts, largest, strict=True)]


def _over_all(scenes: Mapping[str, Any], names: Sequence[str]) -> str:
    """Strategies over all scenes, those of as many rays together, oracles last."""
    first = next(iter(scenes.values()))
    rows = []
    for name in names:
        rays = "oracle" if first["group"][name] == "oracle" else first["rays_per_pixel"][name] - 1
        areas = [_areas(values)[name] for values in scenes.values()]
        times = [values["ms_per_frame"].get(name) for values in scenes.values()]
        cost = "" if None in times or rays == "oracle" else f"{median(times):.1f}"
        means = (f"{mean:.2f}" if mean >= 0.1 else f"{mean:.3f}" for mean in geometric_means(scenes, name, VARIANCE))
        rows.append([rays, f"`{name}`", *means, f"{min(areas):.3f} to {max(areas):.3f}", cost])
    head = ["further rays", "strategy", *(f"{budget}%" for budget in BUDGETS), "excess area", "ms"]
    return markdown_table(head, rows)


def _scenes(scenes: Mapping[str, Any]) -> str:
    at = round(100 * BUDGET)
    return markdown_table(
        ["scene", "depth", "nodes", "frames", "look-ahead", "unrefined", f"`{VARIANCE}`, {BUDGET:.0%}", "optimal"],
        (
            [
                scene, values["depth"], f"{values['nodes']:,}", values["frames"], f"{values['lookahead_share']:.1%}",
                f"{1e4 * values['mse']['random'][0]:.1f}", f"{1e4 * values['mse'][VARIANCE][at]:.1f}",
                f"{1e4 * values['mse']['optimal'][at]:.1f}",
            ]
            for scene, values in scenes.items()
        ),
    )  # fmt: skip


def _by_scene(results: Mapping[str, Any], names: Sequence[str], cell: Callable[[Any, str], str]) -> str:
    columns = dict(results["scenes"])
    if "pooled" in results:
        columns["pooled"] = results["pooled"]
    rows = ([f"`{name}`", *(cell(values, name) for values in columns.values())] for name in names)
    return markdown_table(["strategy", *columns], rows)


def _pooled(results: Mapping[str, Any], names: Sequence[str]) -> list[str]:
    """Error over that of the variance at several budgets, all scenes pooled; nothing for a single scene."""
    if "pooled" not in results:
        return []
    rows = ([f"`{name}`", *(_over_variance(results["pooled"], name, at) for at in BUDGETS_SHOWN)] for name in names)
    table = markdown_table(["strategy", *(f"{budget:.0%}" for budget in BUDGETS_SHOWN)], rows)
    return [f"All scenes pooled: error over that of `{VARIANCE}` at several budgets.", table]


def _over_variance(values: Mapping[str, Any], name: str, budget: float = BUDGET) -> str:
    at = round(100 * budget)
    variance = values["mse"][VARIANCE][at]
    return f"{values['mse'][name][at] / variance:.2f}" if variance else ""


def _areas(values: Mapping[str, Any]) -> dict[str, float]:
    areas = {name: item["value"] for name, item in values["excess_area"].items()}
    return {name: float("nan") if area is None else area for name, area in areas.items()}


def _costs(scenes: Mapping[str, Any], names: Sequence[str]) -> str:
    first = next(iter(scenes.values()))
    rows = []
    for name in [VARIANCE, *names]:
        times = [values["ms_per_frame"].get(name) for values in scenes.values()]
        if None not in times:
            each = [f"{time:.1f}" for time in times]
            rows.append([f"`{name}`", first["rays_per_pixel"][name], f"{median(times):.1f}", *each])
    return markdown_table(["strategy", "rays", "median", *scenes], rows)


def _intervals(half: Mapping[str, Any]) -> str:
    shown = [name for name in _RATIOS if all(name in found for found in half.values())]
    rows = []
    for scene, found in half.items():
        cells = []
        for name in shown:
            values = found[name]
            at = values["budgets"].index(BUDGET)
            cells.append(f"{values['value'][at]:.2f} ({values['low'][at]:.2f} to {values['high'][at]:.2f})")
        rows.append(["pooled" if scene == POOLED else scene, *cells])
    return markdown_table(["scene", *(f"`{name}`" for name in shown)], rows)


def _lowest(lowest: Mapping[str, Any]) -> str:
    shown = [name for name in next(iter(lowest.values())) if network_name(name) is None]
    rows = [[scene, *(_from(found[name]) for name in shown)] for scene, found in lowest.items()]
    return markdown_table(["scene", *(f"`{name}`" for name in shown)], rows)


def _from(values: Mapping[str, Any]) -> str:
    share = f"{values['share_of_budgets']:.0%}"
    if values["value"] is None:
        return f"never for good; {share}"
    high = "never" if values["high"] is None else f"{values['high']:.0%}"
    return f"{values['value']:.0%} ({values['low']:.0%} to {high}); {share}"


def _pictures(scenes: Mapping[str, Any]) -> str:
    first = next(iter(scenes.values()))
    names = [*(f"{side} x {side}" for side in first["uniform"]), *(f"`{name}`" for name in first["predicted"])]
    rows = (
        [scene]
        + [
            f"{1e4 * picture['mse']:.1f} in {picture['ms_per_frame']:.1f} ms"
            for picture in (*values["uniform"].values(), *values["predicted"].values())
        ]
        for scene, values in scenes.items()
    )
    return markdown_table(["scene", *names], rows)


def _predicted(scenes: Mapping[str, Any]) -> str:
    rows = []
    for scene, values in scenes.items():
        variance = values["mse"][VARIANCE]
        for name, picture in values["predicted"].items():
            ratios = [
                f"{picture['mse_refined'][at] / variance[at]:.2f}" if variance[at] else ""
                for at in (round(100 * budget) for budget in (0.0, *BUDGETS_SHOWN))
            ]
            rows.append([scene, f"`{name}`", *ratios])
    return markdown_table(["scene", "picture", *(f"{budget:.0%}" for budget in (0.0, *BUDGETS_SHOWN))], rows)


def _quality(found: Sequence[Mapping[str, Any]]) -> str:
    """Means over scenes of each metric that was run on all of them."""
    at = found[0]["budgets"].index(BUDGET)
    columns: dict[str, dict[str, float]] = {}
    for metric, rows in found[0]["metrics"].items():
        means = {name: [quality["metrics"][metric][name][at] for quality in found] for name in rows}
        if all(value is not None for values in means.values() for value in values):
            columns[metric] = {name: sum(values) / len(values) for name, values in means.items()}
    names = list(next(iter(found[0]["metrics"].values())))
    rows = ([f"`{name}`", *(f"{values[name]:.4f}" for values in columns.values())] for name in names)
    return markdown_table(["strategy", *columns], rows)


def _matrix(found: Mapping[str, Any], scenes: Iterable[str]) -> str:
    rows = []
    for network, cells in found["networks"].items():
        texts = [(f"{cells[scene]['value']:.2f}", cells[scene]["seen"]) for scene in scenes]
        rows.append([network, *(f"**{text}**" if seen else text for text, seen in texts)])
    return markdown_table(["trained on", *scenes], rows) + "\n\nBold: the scene was in the training."
