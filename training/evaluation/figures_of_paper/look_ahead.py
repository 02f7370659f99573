# SPDX-License-Identifier: GPL-3.0-or-later
"""One object from several distances: its true error and the prediction of each look-ahead (Fig. 4 of the paper).

The object is a table of San Miguel. Its dark wood is one centimetre below a bright cloth.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ....patchnet_addon.codes.coded_octree import CodedOctree
from ....patchnet_addon.image.tone import gray
from ....patchnet_addon.octree.octree import Octree
from ....patchnet_addon.runtime.bounds import LOOKAHEADS
from ....patchnet_addon.runtime.progress import Steps
from ....patchnet_addon.sampling.errors import sum_left_after
from ....patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ....patchnet_addon.sampling.refine import refinement_order
from ....patchnet_addon.sampling.trace import trace_view
from ....patchnet_addon.tracing.camera import Camera
from ...strategies.registry import EVALUATED
from ..catalogue import SCENES, TWO_LIGHTS
from ..panels import BLUE, GRAY, GREEN, ORANGE, PATTERN_BUDGET, PURPLE, save_panels, show_picture, show_values
from .split import found_share

BOX_WORLD = np.array([[11.705, -8.33, 0.488], [13.325, -6.71, 0.699]])
"""Bounding box of the cloth, object `Tela Mesa A` of the file."""
NEAREST_WORLD = 2.0  # from the middle of the cloth: rays then stop in voxels of 2.66 cm, the cube's side / 2^11
DISTANCES = (1.0, 2.0**0.5, 2.0, 2.0**1.5, 4.0)  # times NEAREST_WORLD
SHOWN = (1.0, 2.0, 4.0)  # of DISTANCES
AZIMUTHS = (70.0, 90.0, 110.0)  # degrees; the middle one is shown, errors are pooled over all
ELEVATION = 40.0
SIZE_PX = 130  # of the nearest picture; all pictures have pixels of the same angle, and show only the table
# Objects on tables, which would hide the cloths.
_TABLEWARE = (
    "cenicero", "copas", "cromo", "cubiertos", "individual", "pimienta", "plato a", "sal", "vela", "vidriosalero",
)  # fmt: skip
_FIT_FOV = np.radians(50.0)  # of the views of `patchnet octree`, and of the nearest picture
_PIXEL = 2.0 * np.tan(_FIT_FOV / 2) / SIZE_PX  # side of a pixel at distance 1
EXACT, NETWORK = "patchnet-behind-exact", "patchnet-behind"  # whose scores are luminance errors
PLAIN = ("ss-variance", "optimal")
_QUANTILE = 0.995  # of the shown errors: end of the color scale
_COLORS = {1: GREEN, 2: BLUE, 3: PURPLE}
_PANEL = 1.75  # inches
_PICTURES = 3  # beside the scores: preview, reference, error


def table_camera(distance: float, azimuth: float) -> Camera:
    """Camera that frames the table from `distance` times NEAREST_WORLD; azimuth in degrees."""
    size = round(SIZE_PX / distance)
    fov = 2.0 * np.arctan(size * _PIXEL / 2)
    name = f"{distance * NEAREST_WORLD:.1f} m, azimuth {azimuth:g}"
    return Camera.look_at(_position(distance, azimuth), _middle(), fov=fov, size_px=(size, size), name=name)


def _middle() -> np.ndarray:
    """(3,) middle of the upper side of the cloth."""
    return np.append(BOX_WORLD.mean(axis=0)[:2], BOX_WORLD[1, 2])


def _position(distance: float, azimuth: float) -> np.ndarray:
    around, above = np.radians([azimuth, ELEVATION])
    away = np.array([np.cos(above) * np.cos(around), np.cos(above) * np.sin(around), np.sin(above)])
    return np.asarray(_middle() + NEAREST_WORLD * distance * away)


def _views() -> tuple[tuple[float, ...], ...]:
    """Positions and targets of the cameras, rounded to 0.1 mm for the command line."""
    target = _middle()
    cameras = [_position(distance, azimuth) for distance in DISTANCES for azimuth in AZIMUTHS]
    return tuple(tuple(float(value) for value in np.round([*position, *target], 4)) for position in cameras)


SCENE = replace(
    SCENES["san-miguel-bare"],
    name="san-miguel-table",
    title="San Miguel, a table",
    light=TWO_LIGHTS,
    without=(*SCENES["san-miguel-bare"].without, *_TABLEWARE),
    bisect=None,
    views=_views(),
    # Views of twice the pixels have leaves a level deeper: for the look-ahead of 2 that octrees are fitted to, and 3.
    view_px=SIZE_PX * 2 ** (max(LOOKAHEADS) - 2),
)


@dataclass(frozen=True, eq=False)
class DistanceView:
    """View from one distance.

    scores: (P,) by strategy, those of EXACT and NETWORK with their levels of look-ahead after a space. region: (P,)
    bool, pixels whose ray stops in the box of interest, or within a voxel of it. look_ahead: share of hits with real
    descendants by levels. voxel_world: median side of the voxels that rays stop in.
    """

    camera: Camera
    buffers: PixelBuffers
    scores: Mapping[str, np.ndarray]
    region: np.ndarray
    look_ahead: Mapping[int, float]
    voxel_world: float

    @property
    def error(self) -> np.ndarray:
        """(H, W) absolute luminance error of the preview."""
        assert self.buffers.reference is not None
        return self.buffers.picture(np.abs(self.buffers.preview - self.buffers.reference))


def named(strategy: str, lookahead: int) -> str:
    """Name of a strategy with its look-ahead."""
    return f"{strategy} {lookahead}"


def distance_view(
    octree: Octree, camera: Camera, box_world: np.ndarray, coded: Sequence[CodedOctree] = ()
) -> Steps[DistanceView]:
    """Trace a view with all look-aheads.

    box_world: (2, 3) corners of the box of interest. coded: octrees with the codes of further networks.
    """
    plain = [EVALUATED[name] for name in PLAIN]
    buffers = yield from trace_view(octree, camera, plain)
    scores = {strategy.name: strategy.scores(buffers) for strategy in plain}
    hits = buffers.hits.node[buffers.hit]
    shares = {}
    # Pixels and reference are the same for all look-aheads, so they are not rendered again.
    for lookahead in LOOKAHEADS:
        exact = EVALUATED[EXACT]
        view = yield from trace_view(octree, camera, [exact], reference=False, lookahead=lookahead)
        scores[named(EXACT, lookahead)] = exact.scores(view)
        shares[lookahead] = float(octree.look_ahead(lookahead)[hits].mean()) if len(hits) else 0.0
    for each in coded:
        network = EVALUATED[NETWORK]
        view = yield from trace_view(octree, camera, [network], coded=each, reference=False)
        scores[named(NETWORK, each.weights.lookahead)] = network.scores(view)
    levels = octree.level_of(hits)
    voxel = octree.grid.side_world * 2.0 ** -float(np.median(levels)) if len(levels) else float("nan")
    seen = buffers.hits
    points = camera.position_world + seen.direction * np.where(seen.hit, seen.t_world, 0.0)[:, None]
    inside = (points >= box_world[0] - voxel) & (points <= box_world[1] + voxel)
    return DistanceView(camera, buffers, scores, seen.hit & inside.all(axis=1), shares, voxel)


def pooled_values(views: Sequence[DistanceView]) -> dict[str, Any]:
    """Figures of the views from one distance as plain JSON values, errors pooled over all of them.

    region: of the pixels of the region, where the whole budget is spent. picture: of all active pixels.
    """
    hits = [int(np.count_nonzero(view.buffers.hit)) for view in views]
    return {
        "distance": float(np.mean([_distance(view) for view in views])),
        "voxel": views[0].voxel_world,
        "look_ahead_share": {
            str(levels): float(np.average([view.look_ahead[levels] for view in views], weights=hits))
            for levels in LOOKAHEADS
        },
        "region": _errors(views, [view.region & view.buffers.active for view in views]),
        "picture": _errors(views, [view.buffers.active for view in views]),
    }  # fmt: skip


def _distance(view: DistanceView) -> float:
    """Median distance of the region, or else of all hits, along the viewing direction, in world units."""
    seen = view.region if view.region.any() else view.buffers.hit
    return float(np.median(view.buffers.hits.z_world[seen])) if seen.any() else float("nan")


def _errors(views: Sequence[DistanceView], masks: Sequence[np.ndarray]) -> dict[str, Any]:
    """Errors by strategy, before and after each view's budget within its mask (P,) bool."""
    pixels = max(sum(int(np.count_nonzero(mask)) for mask in masks), 1)
    before = _left(views, masks, PLAIN[0], 0.0) / pixels
    left = {name: _left(views, masks, name, PATTERN_BUDGET) / pixels for name in views[0].scores}
    found = {name: {"mse": mse, "found": found_share(before, mse)} for name, mse in left.items()}
    return {"pixels": pixels, "mse": before, "strategies": found}


def _left(views: Sequence[DistanceView], masks: Sequence[np.ndarray], name: str, budget: float) -> float:
    """Sum over views of the remaining squared error after a budget within the masks."""
    total = 0.0
    for view, mask in zip(views, masks, strict=True):
        order = refinement_order(view.buffers, view.scores[name])
        total += float(sum_left_after(view.buffers, order[mask[order]], [budget])[0])
    return total


def draw_look_ahead(
    shown: Sequence[DistanceView],
    values: Sequence[Mapping[str, Any]],
    shown_values: Sequence[Mapping[str, Any]],
    folder: Path,
    name: str,
    title: str,
) -> list[Path]:
    """Draw a row for each shown view, nearest first, and the found share of the error over distance.

    Scores of networks form a row below the exact ones of the same look-ahead. values: of `pooled_values` for all
    distances. shown_values: for each view alone. Returns the files; raises PatchNetError if one cannot be written.
    """
    kinds = [kind for kind in (EXACT, NETWORK) if not shown[0].scores.keys().isdisjoint(_names(kind))]
    columns, rows = _PICTURES + len(LOOKAHEADS), len(kinds) * len(shown)
    size = _PANEL * columns + 1.4, (_PANEL + 0.3) * rows + 3.6
    figure = Figure(figsize=size, dpi=150, layout="constrained")
    figure.suptitle(title, fontsize=11)
    parts: Any = figure.subfigures(2, 1, height_ratios=(size[1] - 3.3, 3.3))
    above, below = parts
    largest = float(np.quantile(np.concatenate([view.error.ravel() for view in shown]), _QUANTILE)) or 1.0
    panels = above.subplots(rows, columns, squeeze=False).reshape(len(shown), len(kinds), columns)
    for axes in panels.flat:
        axes.set_axis_off()
    for lines, view, found in zip(panels, shown, shown_values, strict=True):
        _draw_pictures(lines[0], view, found, largest)
        for line, kind in zip(lines, kinds, strict=True):
            _draw_scores(line[_PICTURES:], _names(kind), view, found, largest)
    image = panels[0, 0, 2].images[0]
    above.colorbar(image, ax=above.axes, shrink=0.6, label="luminance error, true and expected")
    left, right = below.subplots(1, 2, sharey=True)
    _draw_found(left, values, "region", "pixels of the cloth")
    _draw_found(right, values, "picture", "all pixels")
    left.set_ylabel(f"squared error found\nby {PATTERN_BUDGET:.0%} of the pixels (%)")
    right.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return save_panels(figure, folder, name)


def _names(strategy: str) -> list[str]:
    return [named(strategy, lookahead) for lookahead in LOOKAHEADS]


def _draw_pictures(row: Sequence[Axes], view: DistanceView, found: Mapping[str, Any], largest: float) -> None:
    """Preview, reference, and error."""
    buffers = view.buffers
    assert buffers.reference is not None
    voxel = f"{100 * view.voxel_world:.2g} cm"
    show_picture(row[0], gray(buffers.picture(buffers.preview)), f"{found['distance']:.1f} m, voxels {voxel}")
    show_picture(row[1], gray(buffers.picture(buffers.reference)), "32 x 32 rays")
    show_values(row[2], view.error, largest, "true error")


def _draw_scores(
    row: Sequence[Axes], names: Sequence[str], view: DistanceView, found: Mapping[str, Any], largest: float
) -> None:
    """Scores with their found shares; empty for a look-ahead without a network."""
    for axes, name in zip(row, names, strict=True):
        if name in view.scores:
            kind, lookahead = name.split()
            label = "exact" if kind == EXACT else "network"
            title = f"{label}, {lookahead} ahead: {found['region']['strategies'][name]['found']:.0%}"
            show_values(axes, view.buffers.picture(view.scores[name]), largest, title)


def _draw_found(axes: Axes, values: Sequence[Mapping[str, Any]], part: str, title: str) -> None:
    """Found share of the squared error over distance, a line per strategy."""
    distances = [each["distance"] for each in values]

    def draw(name: str, label: str, style: str, color: str) -> None:
        shares = [100 * each[part]["strategies"][name]["found"] for each in values]
        axes.plot(distances, shares, style, color=color, lw=1.6, ms=4, label=label)

    draw(PLAIN[1], "optimal", ":", GRAY)
    for kind, style, label in ((EXACT, "o-", "exact"), (NETWORK, "s--", "network")):
        for lookahead in reversed(LOOKAHEADS):
            name = named(kind, lookahead)
            if name in values[0][part]["strategies"]:
                ahead = "1 level" if lookahead == 1 else f"{lookahead} levels"
                draw(name, f"{label}, {ahead} ahead", style, _COLORS[lookahead])
    draw(PLAIN[0], PLAIN[0], "--", ORANGE)
    axes.set(xlabel="distance (m)", title=title, xscale="log")
    axes.set_xticks(distances, [f"{distance:.1f}" for distance in distances])
    axes.minorticks_off()
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
