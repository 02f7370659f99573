# SPDX-License-Identifier: GPL-3.0-or-later
"""Figures 2 and 4 of the paper: scenes, views, and files."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ....patchnet_addon.codes.coded_octree import CodedOctree
from ....patchnet_addon.network.weights import Weights
from ....patchnet_addon.octree.file import load_octree, octree_hash
from ....patchnet_addon.runtime.errors import SettingError
from ....patchnet_addon.runtime.file_kinds import PNG, FileKind
from ....patchnet_addon.runtime.progress import Progress, Steps
from ....patchnet_addon.runtime.replace import replaced_file
from ...file_kinds import FIGURE_VALUES, SVG
from ..catalogue import SCENES as CATALOGUE
from ..catalogue import Scene
from ..codes import coded_octree
from . import look_ahead
from .look_ahead import DistanceView, distance_view, draw_look_ahead, pooled_values
from .split import draw_split, hardest_end, split_view

SPLIT, LOOK_AHEAD = "split", "look-ahead"
SCENES: dict[str, Scene] = {SPLIT: CATALOGUE["shuttle"], LOOK_AHEAD: look_ahead.SCENE}
SPLIT_PX = 520


def figure_files(figure: str) -> dict[str, FileKind]:
    """Names of a figure's files with their kinds."""
    return {f"{figure}.png": PNG, f"{figure}.svg": SVG, f"{figure}.json": FIGURE_VALUES}


def make_split(octree: Path, network: Weights, out: Path) -> Steps[list[Path]]:
    """Draw the figure of the shuttle from its octree file; returns its files."""
    coded = yield from coded_octree(octree, network)
    camera = yield from hardest_end(coded.octree, (SPLIT_PX, SPLIT_PX), network.lookahead)
    view = yield from split_view(coded, camera)
    paths = draw_split(view, out, SPLIT, _title(SCENES[SPLIT]))
    return [*paths, _write(SPLIT, octree_hash(coded.octree), {SPLIT: network}, view.values(), out)]


def make_look_ahead(octree: Path, networks: Mapping[str, Weights], out: Path) -> Steps[list[Path]]:
    """Draw the figure of the table, scores of `networks` by name beside the exact ones; returns its files."""
    coded: list[CodedOctree] = []
    for network in networks.values():
        coded.append((yield from coded_octree(octree, network)))
    tree = coded[0].octree if coded else load_octree(octree)
    views: dict[float, list[DistanceView]] = {}
    for number, distance in enumerate(look_ahead.DISTANCES):
        yield Progress(number, len(look_ahead.DISTANCES), "Looking from several distances")
        views[distance] = []
        for azimuth in look_ahead.AZIMUTHS:
            camera = look_ahead.table_camera(distance, azimuth)
            views[distance].append((yield from distance_view(tree, camera, look_ahead.BOX_WORLD, coded)))
    values = [pooled_values(views[distance]) for distance in look_ahead.DISTANCES]
    shown = [views[distance][len(look_ahead.AZIMUTHS) // 2] for distance in look_ahead.SHOWN]
    shown_values = [pooled_values([view]) for view in shown]
    paths = draw_look_ahead(shown, values, shown_values, out, LOOK_AHEAD, _title(SCENES[LOOK_AHEAD]))
    return [*paths, _write(LOOK_AHEAD, octree_hash(tree), networks, {"distances": values, "shown": shown_values}, out)]


def check_networks(networks: Iterable[Weights], names: Sequence[str]) -> None:
    """Raise SettingError if two networks have the same name or look-ahead: the figure has one column for each."""
    for each in names:
        if names.count(each) > 1:
            raise SettingError(f"Two networks are called {each!r}: give each a different name in --networks")
    levels = [network.lookahead for network in networks]
    for level in levels:
        if levels.count(level) > 1:
            raise SettingError(f"Two weights files look {level} levels ahead: give one file for each look-ahead")


def _title(scene: Scene) -> str:
    """Title with credits as the scene's licence requires."""
    return f"{scene.title} ({scene.source}, {scene.licence})"


def _write(figure: str, octree: str, networks: Mapping[str, Weights], values: Mapping[str, Any], out: Path) -> Path:
    scene = SCENES[figure]
    about = {
        "figure": figure, "scene": scene.name, "source": scene.source, "licence": scene.licence, "octree": octree,
        "weights": {name: network.hash for name, network in networks.items()},
    }  # fmt: skip
    path = out / f"{figure}.json"
    with replaced_file(path, FIGURE_VALUES) as file:
        file.write(json.dumps(about | dict(values), indent=1, allow_nan=False).encode())
    return path
