# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet lab evaluate-cycles`: compare all strategies in a few cameras of each scene's track, with pixels refined by
Cycles. The error of the voxels themselves is stated separately.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ....commands.shared.arguments import add_number, add_out
from ....commands.shared.job_arguments import require_blender
from ....commands.shared.lines import say_result
from ....patchnet_addon.runtime import bounds
from ....patchnet_addon.runtime.errors import SettingError
from ....patchnet_addon.runtime.outputs import check_outputs
from ....patchnet_addon.runtime.progress import Steps, drain, labelled
from ....patchnet_addon.runtime.quantities import counted
from ....patchnet_addon.runtime.replace import replaced_file
from ... import bounds as lab_bounds
from ...file_kinds import CYCLES_EVALUATION, EVALUATION_TABLES
from ..arguments import named_file
from .scene_arguments import add_track, scenes_named, stated, track_settings

if TYPE_CHECKING:
    from ....patchnet_addon.codes.coded_octree import CodedOctree
    from ....patchnet_addon.network.weights import Weights
    from ...evaluation.catalogue import Scene
    from ...evaluation.cycles_reference import CameraResult

RESULTS, TABLES, FIGURES = "cycles.json", "cycles.md", "figures"
OUTPUTS = {RESULTS: CYCLES_EVALUATION, TABLES: EVALUATION_TABLES}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument("--scenes", default="", metavar="NAME,NAME", help="scenes of the catalogue, or all")
    parser.add_argument(
        "--octree", type=named_file, action="append", default=[], metavar="NAME=FILE", help="octree file of a scene "
        "(created in --out); may be repeated",
    )  # fmt: skip
    add_number(parser, "--cameras", lab_bounds.TRACK_FRAMES, "cameras of each scene", 3)
    add_number(parser, "--samples", bounds.RENDER_SAMPLES, "Cycles samples per pixel", 256)
    add_track(parser)
    parser.add_argument("--weights", type=Path, help="weights file (the shipped one)")
    add_out(parser, "folder for results and figures, for example that of `patchnet lab evaluate`", required=True)


def run(args: argparse.Namespace) -> int:
    """Evaluate scene by scene, write results and print their path; returns 0; raises PatchNetError."""
    from ...evaluation import require

    require()
    from ....commands.shared.progress_lines import progress_lines
    from ...encoders import load_weights
    from ...evaluation.cycles_reference import DIFFUSE, cycles_results
    from ...evaluation.figures import draw_budgets
    from ...strategies.registry import EVALUATED

    scenes, octrees = _scenes(args)
    inputs = [*octrees.values(), *filter(None, [args.weights])]
    check_outputs({args.out / name: kind for name, kind in OUTPUTS.items()}, inputs, folder=args.out)
    require_blender()
    args.out.mkdir(parents=True, exist_ok=True)
    weights = load_weights(args.weights)
    found: dict[str, Any] = {}
    for scene in scenes:
        steps = _measured(scene, octrees.get(scene.name), args, weights)
        coded, cameras = drain(labelled(steps, f"{scene.title}: {{}}"), progress_lines())
        found[scene.name] = {"light": scene.light} | cycles_results(coded, EVALUATED, cameras)
        truth = found[scene.name]["truths"][DIFFUSE]
        levels = {"octree, 32 x 32 rays": truth["bias"], "noise of Cycles": truth["noise"]}
        title = f"{scene.title}: error against Cycles"
        draw_budgets(found[scene.name], args.out / FIGURES, f"{scene.name}-cycles", title, levels)
        _write(args, found)  # after each scene, since a scene takes long
    say_result(f"{args.out / RESULTS}: {counted(len(found), 'scene')}", file=args.out / RESULTS, scenes=len(found))
    return 0


def _scenes(args: argparse.Namespace) -> tuple[list[Scene], dict[str, Path]]:
    """Scenes and given octree files by name; raises SettingError, and SceneError for a missing file."""
    scenes, octrees = scenes_named(args.scenes), dict(args.octree)
    if not scenes:
        raise SettingError("There is nothing to evaluate: name --scenes of the catalogue, or all")
    strange = octrees.keys() - {scene.name for scene in scenes}
    if strange:
        raise SettingError(f"--octree {sorted(strange)[0]}: --scenes does not contain this scene: add it")
    for scene in scenes:
        scene.path()
    return scenes, octrees


def _measured(
    scene: Scene, given: Path | None, args: argparse.Namespace, weights: Weights
) -> Steps[tuple[CodedOctree, list[CameraResult]]]:
    """Octree with its codes, and results of the scene's cameras; the scene is open in Blender afterwards."""
    import bpy

    from ....commands.shared.quiet import quiet_stdout
    from ....commands.shared.scene_argument import open_or_build
    from ....operators.scene.render_geometry import hide_from_renders
    from ....patchnet_addon.octree.file import load_octree
    from ....patchnet_addon.surface.mesh import AXES
    from ...evaluation.catalogue import scene_octree
    from ...evaluation.codes import kept_codes
    from ...evaluation.cycles_reference import spread_cameras
    from ...evaluation.tracks import camera_track
    from .octree_light import as_in_octree

    octree = load_octree(given or scene_octree(scene, args.out / "octrees"))
    open_or_build(str(scene.path()))
    hide_from_renders(scene.without)
    bisect = None if scene.bisect is None else (AXES.index(scene.bisect[0]), scene.bisect[1])
    with quiet_stdout(), as_in_octree(bpy.context, octree, scene.light, bisect):
        coded = yield from kept_codes(octree, weights, args.out / "scenes" / scene.name)
        track = yield from camera_track(octree, track_settings(args), weights.lookahead)
        results = []
        for camera in spread_cameras(track, args.cameras):
            steps = _camera(coded, camera, scene, args.samples)
            results.append((yield from labelled(steps, f"{camera.name}: {{}}")))
    return coded, results


def _camera(coded: CodedOctree, camera: Any, scene: Scene, samples: int) -> Steps[CameraResult]:
    """Results of a camera. Two Lights are emissive surfaces without gloss: the ground truth of all light is missing."""
    import bpy

    from ....operators.cycles.camera_render import render_halves
    from ...evaluation.catalogue import CYCLES
    from ...evaluation.cycles_reference import COMBINED, DIFFUSE, Truth, measure_camera
    from ...strategies.registry import EVALUATED

    first, second = yield from render_halves(bpy.context, camera, samples)
    exposure = coded.octree.exposure
    truths = {DIFFUSE: Truth.of_halves(first.luminance, second.luminance, exposure)}
    if scene.light == CYCLES:
        truths[COMBINED] = Truth.of_halves(first.combined, second.combined, exposure)
    return (yield from measure_camera(coded, camera, EVALUATED, truths))


def _write(args: argparse.Namespace, found: dict[str, Any]) -> None:
    """Write the results of all scenes so far, tables first."""
    from ...evaluation.tables import cycles_tables, markdown_of

    about = stated(args, "cameras", "samples", "frames", "size", "seed", "weights")
    contents = {
        TABLES: markdown_of(cycles_tables(found)),
        RESULTS: json.dumps({"settings": about, "scenes": found}, indent=1, allow_nan=False),
    }
    for name, content in contents.items():
        with replaced_file(args.out / name, OUTPUTS[name]) as file:
            file.write(content.encode())
