# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet lab evaluate`: compare all strategies on camera tracks of scenes, by error and by cost, with intervals and
figures. A later run skips finished parts.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ....commands.shared.arguments import add_number, add_out
from ....commands.shared.lines import say_result
from ....patchnet_addon.runtime.errors import SettingError
from ....patchnet_addon.runtime.outputs import check_outputs
from ....patchnet_addon.runtime.progress import drain
from ....patchnet_addon.runtime.quantities import counted
from ....patchnet_addon.runtime.replace import replaced_file
from ... import bounds
from ...file_kinds import EVALUATION, EVALUATION_TABLES
from ..arguments import check_octrees, named_file
from .scene_arguments import add_scenes, add_track, scenes_named, stated, track_settings

if TYPE_CHECKING:
    from ...evaluation.codes import EvaluationSettings
    from ...evaluation.evaluate import SceneResult

RESULTS, TABLES, FIGURES = "results.json", "tables.md", "figures"
OUTPUTS = {RESULTS: EVALUATION, TABLES: EVALUATION_TABLES}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument(
        "octrees", nargs="*", type=Path, metavar="OCTREE", help="octree files to evaluate beside --scenes"
    )
    add_scenes(parser)
    add_number(parser, "--every", bounds.TRACK_FRAMES, "evaluate every Nth frame of a track", 10)
    add_track(parser)
    parser.add_argument("--weights", type=Path, help="weights file (the shipped one)")
    parser.add_argument(
        "--maps", type=Path, nargs="+", default=(), metavar="FILE", help="weights files of train-maps, to "
        "evaluate as well",
    )  # fmt: skip
    parser.add_argument(
        "--networks", type=named_file, nargs="+", default=(), metavar="NAME=FILE", help="weights files of train, "
        "evaluated as well, as pn-NAME and pn-NAME-behind; NAME is the scene that was trained on, or without-SCENE",
    )  # fmt: skip
    add_number(parser, "--processes", bounds.THREADS, "processes of one thread each (one for each core)")
    parser.add_argument("--prepare", action="store_true", help="only create octrees and codes")
    add_out(parser, "folder for results, tables and figures", required=True)


def run(args: argparse.Namespace) -> int:
    """Evaluate, write results and print their path; returns 0; raises PatchNetError."""
    from ....commands.shared.progress_lines import progress_lines
    from ...encoders import load_weights
    from ...evaluation import REPORTS, require
    from ...evaluation.codes import EvaluationSettings
    from ...evaluation.evaluate import evaluate, prepare
    from ...evaluation.strategies import patch_networks

    settings = EvaluationSettings(
        track=track_settings(args, args.every),
        weights=args.weights,
        processes=args.processes,
        maps=tuple(args.maps),
        networks=patch_networks(args.networks, load_weights(args.weights).lookahead),
    )
    if not args.scenes.strip(", ") and not args.octrees:
        raise SettingError("There is nothing to evaluate: name --scenes, or octree files")
    require([*(() if args.prepare else REPORTS), *(["torch"] if args.maps else [])])
    check_octrees(args.octrees)
    inputs = [*args.octrees, *args.maps, *filter(None, [args.weights])]
    inputs += [path for _, path in args.networks]
    check_outputs({args.out / name: kind for name, kind in OUTPUTS.items()}, inputs, folder=args.out)
    args.out.mkdir(parents=True, exist_ok=True)
    show = progress_lines()
    octrees = _octrees(args)
    if args.prepare:
        drain(prepare(octrees, settings, args.out), show)
        say_result(f"{args.out}: prepared {counted(len(octrees), 'scene')}", file=args.out, scenes=len(octrees))
        return 0
    scenes = drain(evaluate(octrees, settings, args.out), show)
    _write_results(args, settings, scenes)
    say_result(f"{args.out / TABLES}: {counted(len(scenes), 'scene')}", file=args.out / TABLES, scenes=len(scenes))
    return 0


def _write_results(args: argparse.Namespace, settings: EvaluationSettings, scenes: Sequence[SceneResult]) -> None:
    """Write results, tables and figures."""
    from ...evaluation.results import results_of
    from ...evaluation.strategies import map_names
    from ...evaluation.tables import markdown_of, tables_of

    about = stated(args, "frames", "every", "size", "seed", "weights")
    results = {"settings": about} | results_of(scenes, settings.networks)
    strategies = scenes[0].strategies
    results["maps"] = {name: strategies[name].description for name in map_names(strategies.values())}
    _write(args.out / TABLES, markdown_of(tables_of(results)))
    _write(args.out / RESULTS, json.dumps(results, indent=1, allow_nan=False))
    _draw(args.out / FIGURES, results)


def _octrees(args: argparse.Namespace) -> dict[str, Path]:
    """Octree files by name; creates missing ones of the catalogue."""
    from ...evaluation.catalogue import scene_octree

    scenes = scenes_named(args.scenes) if args.scenes else []  # check all names before creating the first octree
    found = {scene.name: scene_octree(scene, args.out / "octrees") for scene in scenes}
    for path in args.octrees:
        if path.stem in found:
            raise SettingError(f"Two scenes are called {path.stem!r}: rename {path}")
        found[path.stem] = path
    return found


def _write(path: Path, text: str) -> None:
    with replaced_file(path, OUTPUTS[path.name]) as file:
        file.write(text.encode())


def _draw(folder: Path, results: dict[str, Any]) -> None:
    from ...evaluation.figures import draw_budgets, draw_generalisation, draw_overview, draw_times

    for name, values in results["scenes"].items():
        draw_budgets(values, folder, f"{name}-budget", name)
        draw_times(values, folder, f"{name}-time", name)
    if len(results["scenes"]) > 1:
        draw_overview(results["scenes"], folder, "all-scenes")
    draw_generalisation(results["claims"].get("generalisation", {}), folder)
