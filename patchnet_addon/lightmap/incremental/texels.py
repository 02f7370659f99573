# SPDX-License-Identifier: GPL-3.0-or-later
"""Texels of triangles that are taken from other charts of them, and charts of some triangles alone."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..chart_lookup import texel_owners
from ..charts import Charts
from ..packing import FIRST, SINGLE, packed

_SHAPE = ("log_width", "log_height", "origin", "along", "kind")


def same_charts(old: Charts, new: Charts, before: np.ndarray) -> np.ndarray:
    """(T,) bool: a chart has the shape and the paths that it had as triangle `before` (T,), -1 for none."""
    known = before >= 0
    at = np.where(known, before, 0)
    for name in _SHAPE:
        known &= getattr(old, name)[at] == getattr(new, name)
    samples = old.page_samples[old.page[at]] == new.page_samples[new.page]
    shared: np.ndarray = known & samples
    return shared


def copied(target: np.ndarray, new: Charts, texels: np.ndarray, old: Charts, before: np.ndarray) -> None:
    """Write into `target` the texels of all triangles that `before` (T,) names in the old charts; -1 leaves them.

    target, texels: (pages * side * side, C) of the new and of the old charts; charts of both have the same shape.
    """
    for page in np.unique(new.page[before >= 0]).tolist():
        owner = texel_owners(new, page)
        mine = np.flatnonzero((owner >= 0) & (before[owner] >= 0))
        triangle = owner[mine]
        source = before[triangle]
        row, column = np.divmod(mine, new.page_side)
        row = row - new.y[triangle] + old.y[source]
        column = column - new.x[triangle] + old.x[source]
        place = (old.page[source].astype(np.int64) * old.page_side + row) * old.page_side + column
        target[page * new.page_side**2 + mine] = texels[place]


def with_partners(charts: Charts, chosen: np.ndarray) -> np.ndarray:
    """(T,) bool: `chosen` and the triangles that share a rectangle with them: together they stay what half they are."""
    paired = charts.kind != SINGLE
    keys = (charts.page.astype(np.int64) * charts.page_side + charts.y) * charts.page_side + charts.x
    wanted = np.unique(keys[chosen & paired])
    result: np.ndarray = chosen | (paired & np.isin(keys, wanted))
    return result


def charts_of(charts: Charts, chosen: np.ndarray) -> Charts:
    """Charts of the same shapes for the triangles `chosen` (T,) alone, on few pages; others are on page -1.

    Raises ValueError where a triangle is chosen without the one before it in its rectangle (`with_partners`).
    """
    part = np.flatnonzero(chosen)
    sides = np.stack([charts.log_width, charts.log_height], axis=-1)[part]
    samples = charts.page_samples[charts.page[part]]
    classes, shares = np.unique(-samples, return_inverse=True)
    # Partners follow each other, and who has none, one of each shape at most, comes last.
    place = (charts.page[part].astype(np.int64) * charts.page_side + charts.y[part]) * charts.page_side + charts.x[part]
    _, inverse, count = np.unique(place, return_inverse=True, return_counts=True)
    order = np.lexsort((charts.kind[part] != FIRST, place, count[inverse.reshape(-1)] == 1))
    packing = packed(sides[order], shares.reshape(-1)[order].astype(np.uint8), None, charts.page_side)
    if (packing.kind != charts.kind[part[order]]).any():
        raise ValueError("Triangles that share a rectangle have to be chosen together")
    values: dict[str, Any] = {}
    for name in ("page", "x", "y"):
        values[name] = np.full(len(chosen), -1 if name == "page" else 0, np.int32)
        values[name][part[order]] = getattr(packing, name)
    return replace(
        charts,
        page_side=packing.page_side,
        page_samples=(-classes[packing.share] if len(part) else np.ones(1)).astype(np.int32),
        page_size=packing.size,
        **values,
    )
