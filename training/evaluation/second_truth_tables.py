# SPDX-License-Identifier: GPL-3.0-or-later
"""Markdown tables of an evaluation against Cycles, as documentation shows them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..benchmarks.tables import markdown_table
from .claims import VARIANCE
from .markdown import BUDGET, PAIRS, TITLE, counts_ahead
from .over_scenes import BUDGETS
from .second_truth import DIFFUSE

_SHOWN = (
    VARIANCE, "patchnet-plus-0", "patchnet", "patchnet-plus-1", "patchnet-plus-1-staged", "patchnet-behind", "fusion",
    "fine-ray", "fine-ray-variance", "patchnet-plus", "patchnet-plus-staged", "fine-rays-4", "optimal",
)  # fmt: skip


def markdown_of_second_truth(scenes: Mapping[str, Any]) -> str:
    """Tables of scenes by name, as `second_truth_results` gives each: errors, and which strategies are ahead."""
    truths = {name: values["truths"][DIFFUSE] for name, values in scenes.items()}
    parts = [
        TITLE,
        f"Mean squared error times 10,000 against Cycles' diffuse light and emission, at {BUDGET:.0%}. The bias is "
        "that of rays of the octree, the noise that of the render.",
        _errors(truths),
        f"Scenes of {len(truths)} in which one strategy leaves less than another, by budget, and the largest ratio "
        "of both errors.",
        _ahead(truths),
    ]
    return "\n\n".join(parts) + "\n"


def _errors(truths: Mapping[str, Any]) -> str:
    at = round(100 * BUDGET)
    first = next(iter(truths.values()))
    names = [name for name in _SHOWN if name in first["mse"]]
    rows = []
    for scene, values in truths.items():
        found = [values["mse"][name][at] for name in names]
        whole = [values["bias"], values["noise"], values["mse"]["random"][0]]
        rows.append([scene, f"{1e4 * whole[0]:.1f}", f"{1e4 * whole[1]:.2f}"])
        rows[-1] += [f"{1e4 * value:.1f}" for value in (whole[2], *found)]
    return markdown_table(["scene", "bias", "noise", "unrefined", *(f"`{name}`" for name in names)], rows)


def _ahead(truths: Mapping[str, Any]) -> str:
    first = next(iter(truths.values()))
    rows = [
        [f"`{ours}`", f"`{rival}`", *counts_ahead(truths, ours, rival, None)]
        for ours, rivals in PAIRS.items()
        for rival in rivals
        if {ours, rival} <= first["mse"].keys()
    ]
    return markdown_table(["strategy", "rival", *(f"{budget}%" for budget in BUDGETS)], rows)
