# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet check-scenes`: compare the light of random scenes with Cycles: each is right, said by a note to differ, or
wrong. A seed gives the same scene each time; wrong ones are written with pictures.
"""

from __future__ import annotations

import argparse
import re
from collections import Counter
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...commands.shared.arguments import add_out
from ...commands.shared.job_arguments import require_blender
from ...commands.shared.lines import say_result

if TYPE_CHECKING:
    from .checks.judge import Verdict

SCENE = "scene.blend"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument("--seeds", type=_seeds, required=True, metavar="FIRST:LAST", help="seeds of the scenes")
    add_out(parser, "folder for a report, and for each wrong scene and its pictures")


def _seeds(text: str) -> range:
    match = re.fullmatch(r"(\d+):(\d+)", text)
    first, last = map(int, match.groups()) if match else (1, 0)
    if last < first:
        raise argparse.ArgumentTypeError(f"{text!r} is not two seeds in ascending order such as 1:100")
    return range(first, last + 1)


def run(args: argparse.Namespace) -> int:
    """Judge the scenes, print a line for each and a table; returns 0; raises PatchNetError."""
    require_blender()
    from .checks.judge import WORDS

    verdicts: dict[int, Verdict] = {}
    for seed in args.seeds:
        verdicts[seed] = _judged(seed, args.out)
        print(f"{seed:>6} {verdicts[seed].word:<5} {verdicts[seed].why}", flush=True)
        if args.out is not None:
            _write_report(args.out, verdicts)
    counts = Counter(verdict.word for verdict in verdicts.values())
    table = ", ".join(f"{counts[word]} {word}" for word in WORDS)
    say_result(f"{len(verdicts)} scenes: {table}", **{word: counts[word] for word in WORDS})
    return 0


def _judged(seed: int, out: Path | None) -> Verdict:
    """Make a scene and judge it; a wrong one is written."""
    from ...commands.shared.quiet import quiet_stdout
    from .checks.judge import WRONG, judge
    from .checks.random_scene import build_random_scene

    with quiet_stdout():
        verdict = judge(partial(build_random_scene, seed))
        if verdict.word == WRONG and out is not None:
            if verdict.check is not None:  # judging may have changed it
                build_random_scene(seed)
            _write_wrong(out / f"seed-{seed}", verdict)
    return verdict


def _write_wrong(out: Path, verdict: Verdict) -> None:
    """Write the open scene, and report and pictures of its check, if there is one."""
    import bpy

    from ...operators.pipeline.output_files import output_folder
    from ...operators.verify_light import check_files, save_check
    from ...patchnet_addon.runtime.file_kinds import BLEND

    with output_folder(out, check_files(["Camera"]) | {SCENE: BLEND}) as folder:
        bpy.ops.wm.save_as_mainfile(filepath=str(folder / SCENE), copy=True, compress=True)
        if verdict.check is not None:
            save_check(verdict.check, folder, 0.2, {"Camera": "Camera"})


def _write_report(out: Path, verdicts: dict[int, Verdict]) -> None:
    """Write the verdicts so far to report.json."""
    from ...operators.pipeline.reports import versions, write_report

    rows: list[dict[str, Any]] = [
        {"seed": seed, "verdict": verdict.word, "why": verdict.why} for seed, verdict in verdicts.items()
    ]
    out.mkdir(parents=True, exist_ok=True)
    write_report(out, "scene checks", {"seeds": rows, "versions": versions()})
