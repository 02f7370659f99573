# SPDX-License-Identifier: GPL-3.0-or-later
"""Report of an evaluation as one HTML file that needs no other: figures, tables, claims."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from .claims import ORACLES
from .patch_networks import network_name
from .results import POOLED, SHOWN

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 75rem; padding: 0 1rem; color: #222; }
table { border-collapse: collapse; margin: 1rem 0; } th, td { padding: .2rem .7rem; text-align: right; }
th:first-child, td:first-child { text-align: left; } tr:nth-child(even) { background: #f4f4f4; }
th { border-bottom: 2px solid #888; } figure { margin: 1.5rem 0; } svg { max-width: 100%; height: auto; }
.holds { color: #06703f; } .fails { color: #a33; }
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
        _claims(results["claims"]),
        *(_generalisation(results["claims"]["generalisation"], path) for path in generalisation),
        *(f"<h2>All scenes</h2><figure>{_svg(path)}</figure>" for path in figures.get(POOLED, ())),
    ]
    for name, values in results["scenes"].items():
        parts += [f"<h2>{escape(name)}</h2>", _facts(values), _errors(values)]
        parts += [f"<figure>{_svg(path)}</figure>" for path in figures.get(name, ())]
        parts.append(_quality(values["quality"]))
    return "\n".join([*parts, "</body></html>"])


def _facts(values: Mapping[str, Any]) -> str:
    return (
        f"<p>{values['frames']} frames, {values['active_pixels']:,} active pixels, look-ahead on "
        f"{values['lookahead_share']:.1%} of hits; octree of depth {values['depth']} with {values['nodes']:,} nodes. "
        f"Intervals: 95 %, blocks of {values['block_frames'][0]} frames.</p>"
    )


def _errors(values: Mapping[str, Any]) -> str:
    """Table of errors over that of screen-space variance, with cost, grouped by rays."""
    head = ["strategy", "group", "rays a pixel", "ms a frame", *(f"{share:.0%}" for share in SHOWN), "excess area"]
    names = sorted(values["mse"], key=lambda name: (values["rays_per_pixel"][name], _area(values, name)))
    rows = [
        [
            name,
            values["group"][name],
            values["rays_per_pixel"][name],
            f"{values['ms_per_frame'][name]:.1f}" if name in values["ms_per_frame"] else "",
            *(f"{1e4 * values['mse'][name][round(100 * share)]:.2f}" for share in SHOWN),
            _with_interval(values["excess_area"][name]),
        ]
        for name in names
    ]
    uniform = [
        [f"{side} x {side} rays in each pixel", f"{item['ms_per_frame']:.1f}", f"{1e4 * item['mse']:.2f}"]
        for side, item in values["uniform"].items()
    ]
    predicted = [
        [
            f"{name}: what the network expects",
            f"{item['ms_per_frame']:.1f}",
            *(f"{1e4 * item['mse_refined'][round(100 * share)]:.2f}" for share in (0.0, *SHOWN)),
        ]
        for name, item in values["predicted"].items()
    ]
    refined = (f"{share:.0%} refined" for share in SHOWN)
    return (
        "<p>Mean squared error in 1e-4 after refining a share of the active pixels:</p>"
        + _table(head, rows)
        + "<p>Pictures with as many rays in every pixel, and what the network predicts; the latter also refined by its "
        "own priority:</p>"
        + _table(["picture", "ms a frame", "mean squared error in 1e-4", *refined], [*uniform, *predicted])
    )


def _quality(quality: Mapping[str, Any]) -> str:
    """Table of picture metrics of each strategy at one budget; what was not run is left out."""
    at = quality["budgets"].index(0.3)
    metrics = {
        metric: values
        for metric, values in quality["metrics"].items()
        if any(row[at] is not None for row in values.values())
    }
    names = list(next(iter(quality["metrics"].values())))
    rows = [[name, *(_number(values[name][at]) for values in metrics.values())] for name in names]
    return "<p>Picture metrics at 30 %, means over frames:</p>" + _table(["strategy", *metrics], rows)


def _number(value: float | None, digits: int = 4) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def _area(values: Mapping[str, Any], name: str) -> float:
    area = values["excess_area"][name]["value"]
    return float("inf") if area is None else area


def _claims(claims: Mapping[str, Any]) -> str:
    rows = []
    for claim, text in (("lowest", "lowest of the paper's references"), ("lowest_of_more", "lowest of all references")):
        for scene, found in claims[claim].items():
            for name, values in _shipped(found).items():
                rows.append([scene, name, f"{text} from 13 % on", _start(values), _verdict(values, found, name)])
    for scene, found in claims["half"].items():
        for name, values in _shipped(found).items():
            at = values["budgets"].index(0.3)
            ratio = f"{values['value'][at]:.2f} ({values['low'][at]:.2f} to {values['high'][at]:.2f})"
            rows.append([scene, name, "half of ss-variance at 30 %", ratio, _verdict(values, found, name)])
    return _table(["scene", "strategy", "claim", "found", "holds"], rows)


def _shipped(found: Mapping[str, Any]) -> dict[str, Any]:
    """What was found without further networks, which the matrix of generalisation shows."""
    return {name: values for name, values in found.items() if network_name(name) is None}


def _generalisation(found: Mapping[str, Any], figure: Path) -> str:
    """Matrix of all networks and scenes, and how far networks of one scene are apart."""
    rows = [
        [scene, score, *(_number(values[name], 2) for name in ("least", "greatest", "ratio"))]
        for score, scores in found.items()
        for scene, values in scores["spread"].items()
        if values["least"] is not None
    ]
    text = (
        "<h2>Generalisation</h2><p>Errors at 30 % over those of ss-variance, of networks that were trained on one "
        "scene, or on all but one. Solid outlines: tested on the scene that was learned; dashed: on the one left "
        f"out.</p><figure>{_svg(figure)}</figure>"
    )
    if not rows:
        return text
    return f"{text}<p>Spread over networks of one scene:</p>" + _table(
        ["tested on", "score", "least", "greatest", "greatest over least"], rows
    )


def _start(values: Mapping[str, Any]) -> str:
    """Sentence on where a strategy is lowest, and which reference is where it is not."""
    text = "never for good" if values["value"] is None else f"from {values['value']:.0%} on"
    text += f"; at {values['share_of_budgets']:.0%} of these budgets"
    better = [f"{name} at {float(budget):.0%}" for budget, name in values["lowest_reference"].items() if name]
    return f"{text}; lower: {', '.join(better)}" if better else text


def _verdict(values: Mapping[str, Any], found: Mapping[str, Any], name: str) -> str:
    """Yes or no, and where the exact oracle of the same score was asked, whether the network or the score fails."""
    if values["holds"]:
        return "<span class='holds'>yes</span>"
    oracle = found.get(ORACLES.get(name, ""))
    if oracle is None:
        return "<span class='fails'>no</span>"
    why = "the network: with exact patches it holds" if oracle["holds"] else "the score: exact patches fail as well"
    return f"<span class='fails'>no</span>, {why}"


def _with_interval(values: Mapping[str, float | None]) -> str:
    if values["value"] is None:
        return ""
    if values["low"] is None or values["high"] is None:
        return f"{values['value']:.3f}"
    return f"{values['value']:.3f} ({values['low']:.3f} to {values['high']:.3f})"


def _table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """HTML table; cells that begin with a tag are HTML."""
    lines = [f"<tr>{''.join(f'<th>{escape(cell)}</th>' for cell in head)}</tr>"]
    lines += [f"<tr>{''.join(f'<td>{_cell(cell)}</td>' for cell in row)}</tr>" for row in rows]
    return f"<table>{''.join(lines)}</table>"


def _cell(value: object) -> str:
    text = str(value)
    return text if text.startswith("<span") else escape(text)


def _svg(path: Path) -> str:
    """Drawing without the head that only a file of its own may have."""
    text = path.read_text(encoding="utf-8")
    return text[text.index("<svg") :]
