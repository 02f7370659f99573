# SPDX-License-Identifier: GPL-3.0-or-later
"""Report of an evaluation as one HTML file that needs no other: figures, claims, and all tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import pandas as pd

from .results import POOLED
from .tables import claims_table, scene_table, tables_of

_BUDGETS = (5, 10, 13, 20, 30, 50, 70)  # percent
_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 75rem; padding: 0 1rem; color: #222; }
div { overflow-x: auto; } table { border-collapse: collapse; margin: 1rem 0; }
tr:nth-child(even) { background: #f4f4f4; }
th, td { padding: .2rem .7rem; text-align: right; white-space: nowrap; }
th:first-child, td:first-child { text-align: left; }
th { border-bottom: 2px solid #888; } figure { margin: 1.5rem 0; } svg { max-width: 100%; height: auto; }
"""


def report_html(
    results: Mapping[str, Any],
    figures: Mapping[str, Sequence[Path]],
    notes: Sequence[str],
    generalisation: Sequence[Path] = (),
) -> str:
    """HTML of the results. figures: .svg files by scene, those of all scenes by POOLED. notes: sentences about it.

    generalisation: .svg file of its matrix, if networks were trained on single scenes, or on all but one.
    """
    parts = [
        "<!doctype html><html lang='en'><head><title>PatchNet: evaluation</title><meta charset='utf-8'>",
        "<meta name='viewport' content='width=device-width, initial-scale=1'>",
        f"<style>{_STYLE}</style></head><body>",
        "<h1>Evaluation of refinement strategies</h1>",
        *(f"<p>{escape(note)}</p>" for note in notes),
        "<h2>Claims of the paper</h2>",
        _table(claims_table(results["claims"])),
        *(_generalisation(results["claims"]["generalisation"], path) for path in generalisation),
        "<h2>All scenes</h2>",
        *map(_figure, figures.get(POOLED, ())),
    ]
    for title, table in tables_of(results):
        parts += [f"<p>{_text(title)}</p>", _table(table)]
    for name, values in results["scenes"].items():
        parts += [f"<h2>{escape(name)}</h2>", _facts(values), _table(scene_table(values, _BUDGETS))]
        parts += map(_figure, figures.get(name, ()))
    return "\n".join([*parts, "</body></html>"])


def _facts(values: Mapping[str, Any]) -> str:
    return (
        f"<p>{values['frames']} frames, {values['active_pixels']:,} active pixels, look-ahead on "
        f"{values['lookahead_share']:.1%} of hits; octree of depth {values['depth']} with {values['nodes']:,} nodes. "
        f"Intervals: 95 %, blocks of {values['block_frames'][0]} frames. Mean squared error in 1e-4 after refining a "
        "share of the active pixels:</p>"
    )


def _generalisation(found: Mapping[str, Any], figure: Path) -> str:
    """Matrix of all networks and scenes, and how far networks of one scene are apart."""
    spread = pd.DataFrame(
        {"tested on": scene, "score": score} | {name: f"{values[name]:.2f}" for name in ("least", "greatest", "ratio")}
        for score, scores in found.items()
        for scene, values in scores["spread"].items()
        if None not in values.values()
    )
    text = (
        "<h2>Generalisation</h2><p>Errors at 30 % over those of ss-variance, of networks that were trained on one "
        "scene, or on all but one. Solid outlines: tested on the scene that was learned; dashed: on the one left "
        f"out.</p>{_figure(figure)}"
    )
    return text if spread.empty else f"{text}<p>Spread over networks of one scene:</p>{_table(spread)}"


def _table(table: pd.DataFrame) -> str:
    return f"<div>{_text(table.to_html(index=False, border=0, justify='right'), escaped=True)}</div>"


def _text(text: str, *, escaped: bool = False) -> str:
    """HTML of a text without the marks of Markdown."""
    return (text if escaped else escape(text)).replace("`", "").replace("**", "")


def _figure(path: Path) -> str:
    """Drawing without the head that only a file of its own may have."""
    text = path.read_text(encoding="utf-8")
    return f"<figure>{text[text.index('<svg') :]}</figure>"
