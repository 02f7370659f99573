# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet verify-light SCENE`: render a scene with Cycles and its octree from the same cameras, and compare."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..patchnet_addon.runtime import bounds
from .shared.arguments import add_number, add_out
from .shared.job_arguments import add_setting, add_settings, given_settings, require_blender
from .shared.lines import say_note, say_result
from .shared.scene_argument import OWN, add_scene, open_or_build

if TYPE_CHECKING:
    from ..operators.verify_light import CheckSettings, LightCheck

_COLUMNS = ("silhouettes", "creases", "shadows", "textures", "smooth")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    from ..operators.schema.values import GLOSS_OFF, LIGHT
    from ..operators.settings.job_settings import TABLE

    add_scene(parser, "scene file, as for `patchnet run`; demo: the courtyard; room: a closed room; glossy-room", str)
    parser.add_argument("--depth", required=True, help="octree depth; auto: fine only where the cameras look")
    parser.add_argument(
        "--cameras", default="", help="names separated by commas, all, auto, or a number of cameras to place (active)"
    )
    add_number(parser, "--size", bounds.SIZE_PX, "pixels; 0 follows the render aspect", (256, 256), metavar=("W", "H"))
    add_setting(parser, TABLE["shape"])
    add_settings(parser, LIGHT, without=("gloss", "device", "exposure", "color"))
    gloss = [value for value, _, _ in TABLE["gloss"].choices]
    parser.add_argument(
        "--gloss", choices=gloss, default=GLOSS_OFF,
        help="baked gloss; unless off, the render has all light, not only diffuse and emission (off)",
    )  # fmt: skip
    add_number(parser, "--render-samples", bounds.RENDER_SAMPLES, "Cycles samples per pixel of the render", 256)
    add_number(parser, "--rays", bounds.RAYS, "rays per pixel side through the octree", 32)
    add_number(parser, "--difference", bounds.DIFFERENCE, "end of the pictures' legend", 0.2)
    add_out(parser, "folder for the report and the pictures", required=True)


def run(args: argparse.Namespace) -> int:
    """Compare and print a table; returns 0; raises PatchNetError."""
    require_blender()
    import bpy

    from ..operators.pipeline.output_files import output_folder, scene_inputs
    from ..operators.verify_light import check_files, save_check, verify_light
    from ..patchnet_addon.runtime.outputs import check_outputs
    from ..patchnet_addon.runtime.progress import drain
    from .shared.progress_lines import progress_lines
    from .shared.quiet import quiet_stdout

    settings = check_settings(args)
    given = [] if args.scene in (None, *OWN) else [Path(args.scene)]
    check_outputs({args.out / name: kind for name, kind in check_files(()).items()}, given, folder=args.out)
    open_or_build(args.scene)
    folders = camera_folders_of(settings)
    with output_folder(args.out, check_files(folders.values()), [*given, *scene_inputs()]) as folder:
        with quiet_stdout():
            check = drain(verify_light(bpy.context, settings), progress_lines())
        save_check(check, folder, settings.difference, folders)
    print_check(check)
    say_result(f"Pictures and report are in {args.out}", file=args.out, **check.report["mean"])
    return 0


def check_settings(args: argparse.Namespace) -> CheckSettings:
    """Settings from parsed arguments; raises SettingError for values outside their range."""
    from ..operators.schema.values import CAMERAS, LIGHT, OCTREE
    from ..operators.settings.job_settings import JobSettings
    from ..operators.verify_light import CheckSettings
    from ..patchnet_addon.runtime.bounds import PLACED_CAMERAS

    number = int(args.cameras) if args.cameras.isdecimal() else 0
    if number:
        PLACED_CAMERAS.check(number)
    names = () if number else tuple(name.strip() for name in args.cameras.split(",") if name.strip())
    given = given_settings(args, OCTREE, LIGHT, CAMERAS) | {"cameras": names}
    job = JobSettings.of(**given, color=False, out=args.out)
    return CheckSettings(job, number, args.render_samples, args.rays, args.difference)


def camera_folders_of(settings: CheckSettings) -> dict[str, str]:
    """Folder of each camera by name, of the open scene or of cameras to place; raises SceneError."""
    import bpy

    from ..operators.pipeline.output_files import camera_folders, view_folders

    if settings.viewpoints:
        return camera_folders(f"View {number}" for number in range(1, settings.viewpoints + 1))
    return view_folders(bpy.context.scene, settings.job.view.cameras)


def print_check(check: LightCheck) -> None:
    """Print warnings and a row of figures per camera, with the share of the squared error by region."""
    for warning in check.report["warnings"]:
        say_note(warning)
    octree = check.report["octree"]
    print(f"Octree: depth {octree['depth']}, {octree['leaves']:,} voxels, exposure {octree['exposure']:.4g}")
    shares = "  ".join(f"{name:>11}" for name in _COLUMNS)
    print(f"{'camera':<12} {'PSNR dB':>7} {'ratio':>6} {'both hit':>8} {'noise dB':>8} {'FLIP':>7}  {shares}")
    for view in check.report["cameras"]:
        _print_row(view["camera"], view, f"{view['reference_noise_db']:.1f}")
    mean = check.report["mean"]
    print(f"{'all':<12} {mean['psnr_db']:>7.2f} {_ratio(mean['mean_ratio']):>6}")


def _print_row(name: str, figures: dict[str, Any], noise_db: str) -> None:
    regions = "  ".join(f"{figures['regions'][region]['error']:>11.1%}" for region in _COLUMNS)
    flip = "not run" if figures["flip"] is None else format(figures["flip"], ".4f")
    print(
        f"{name:<12} {figures['psnr_db']:>7.2f} {_ratio(figures['mean_ratio']):>6} "
        f"{_ratio(figures['mean_ratio_where_both_hit']):>8} {noise_db:>8} {flip:>7}  {regions}"
    )


def _ratio(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"
